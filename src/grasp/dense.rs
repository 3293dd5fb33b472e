//! Small dense kernels on slices (row-major): sizes are known only at run time and too small for a library's blocking.

use super::arrow::{ROOT, RootVector};

/// `sum x_i y_i`, in four strands so that the additions do not wait for each other.
#[inline(always)]
pub fn dot(x: &[f64], y: &[f64]) -> f64 {
    let mut strands = [0.0; 4];
    let (xs, ys) = (x.chunks_exact(4), y.chunks_exact(4));
    let rest: f64 = xs.remainder().iter().zip(ys.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in xs.zip(ys) {
        for k in 0..4 {
            strands[k] += a[k] * b[k];
        }
    }
    rest + (strands[0] + strands[2]) + (strands[1] + strands[3])
}

/// Euclidean norm.
pub fn norm(x: &[f64]) -> f64 {
    dot(x, x).sqrt()
}

/// `y += a x`
#[inline(always)]
pub fn axpy(a: f64, x: &[f64], y: &mut [f64]) {
    for (y, x) in y.iter_mut().zip(x) {
        *y += a * x;
    }
}

/// Solves `A x = b` in place for a symmetric positive definite `A`, of which the lower triangle is read and replaced by
/// its factor. A pivot that rounding makes non-positive is raised to the smallest positive number: the callers'
/// matrices are bounded below by the identity.
#[inline(always)]
pub fn cholesky_solve(a: &mut [RootVector; ROOT], b: &mut RootVector) {
    let mut inverse = [0.0; ROOT];
    for j in 0..ROOT {
        let (head, tail) = a.split_at_mut(j + 1);
        let row = &mut head[j];
        let pivot = row[j] - dot(&row[..j], &row[..j]);
        inverse[j] = 1.0 / pivot.max(f64::MIN_POSITIVE).sqrt();
        for below in tail {
            below[j] = (below[j] - dot(&below[..j], &row[..j])) * inverse[j];
        }
        b[j] = (b[j] - dot(&row[..j], &b[..j])) * inverse[j];
    }
    for j in (0..ROOT).rev() {
        b[j] *= inverse[j];
        let x = b[j];
        axpy(-x, &a[j][..j], &mut b[..j]);
    }
}

/// Solves `A x = b` and `A X = B` in place by Gaussian elimination with partial pivoting, `A` of n rows, `B` square.
/// `A = I + C W` with positive semidefinite `C`, `W` is never singular.
pub fn lu_solve(a: &mut [f64], n: usize, b: &mut [f64], many: &mut [f64]) {
    for k in 0..n {
        let pivot = (k..n).max_by(|&i, &j| a[i * n + k].abs().total_cmp(&a[j * n + k].abs())).unwrap_or(k);
        if pivot != k {
            for c in 0..n {
                a.swap(k * n + c, pivot * n + c);
                many.swap(k * n + c, pivot * n + c);
            }
            b.swap(k, pivot);
        }
        let inverse = 1.0 / a[k * n + k];
        for i in k + 1..n {
            let factor = a[i * n + k] * inverse;
            if factor != 0.0 {
                let (upper, lower) = a.split_at_mut(i * n);
                axpy(-factor, &upper[k * n + k..(k + 1) * n], &mut lower[k..n]);
                let (upper, lower) = many.split_at_mut(i * n);
                axpy(-factor, &upper[k * n..(k + 1) * n], &mut lower[..n]);
                b[i] -= factor * b[k];
            }
        }
    }
    for k in (0..n).rev() {
        let inverse = 1.0 / a[k * n + k];
        for c in k + 1..n {
            let factor = a[k * n + c];
            b[k] -= factor * b[c];
            let (upper, lower) = many.split_at_mut(c * n);
            axpy(-factor, &lower[..n], &mut upper[k * n..(k + 1) * n]);
        }
        b[k] *= inverse;
        for x in &mut many[k * n..(k + 1) * n] {
            *x *= inverse;
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::needless_range_loop)]
    use super::*;

    #[test]
    fn solves_what_was_multiplied() {
        let n = 5;
        let a: Vec<f64> = (0..n * n).map(|i| (i as f64 * 1.7).sin()).collect();
        let x: Vec<f64> = (0..n).map(|i| i as f64 - 1.5).collect();
        let mut b: Vec<f64> = (0..n).map(|i| dot(&a[i * n..(i + 1) * n], &x)).collect();
        let mut many = a.clone();
        lu_solve(&mut a.clone(), n, &mut b, &mut many);
        for i in 0..n {
            assert!((b[i] - x[i]).abs() < 1e-12);
            for j in 0..n {
                assert!((many[i * n + j] - f64::from(i == j)).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn factors_a_positive_definite_matrix() {
        let mut a = [[0.0; ROOT]; ROOT];
        for i in 0..ROOT {
            for j in 0..ROOT {
                a[i][j] = (-((i as f64 - j as f64) / 3.0).powi(2)).exp() + f64::from(i == j);
            }
        }
        let x: RootVector = std::array::from_fn(|i| (i as f64).cos());
        let mut b: RootVector = std::array::from_fn(|i| dot(&a[i], &x));
        cholesky_solve(&mut a, &mut b);
        assert!(b.iter().zip(&x).all(|(a, b)| (a - b).abs() < 1e-12));
    }
}
