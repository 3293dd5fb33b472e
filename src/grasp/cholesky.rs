//! Cholesky factors of symmetric positive definite matrices whose size is known at run time only, in place, row-major.

use super::dense::{axpy, dot};

/// Replaces the lower triangle of `a` (n x n) by its factor `L`, `a = L L^T`. A pivot that rounding makes non-positive is
/// raised to the smallest positive number.
pub fn factor(a: &mut [f64], n: usize) {
    for i in 0..n {
        for j in 0..=i {
            let (head, tail) = a.split_at_mut(i * n);
            let row = &mut tail[..n];
            if i == j {
                let pivot = row[i] - dot(&row[..i], &row[..i]);
                row[i] = pivot.max(f64::MIN_POSITIVE).sqrt();
            } else {
                let other = &head[j * n..j * n + j + 1];
                row[j] = (row[j] - dot(&row[..j], &other[..j])) / other[j];
            }
        }
    }
}

/// Solves `L L^T x = b` in place.
pub fn solve(l: &[f64], n: usize, b: &mut [f64]) {
    for i in 0..n {
        let row = &l[i * n..i * n + i + 1];
        b[i] = (b[i] - dot(&row[..i], &b[..i])) / row[i];
    }
    for i in (0..n).rev() {
        b[i] /= l[i * n + i];
        let (head, tail) = b.split_at_mut(i);
        axpy(-tail[0], &l[i * n..i * n + i], head);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solves_what_it_factors() {
        for n in 1..9 {
            let b = |i: usize, j: usize| (1.0 + 2.0 * i as f64 + 0.7 * (i * j) as f64).sin();
            let mut a: Vec<f64> = (0..n * n).map(|e| (0..n).map(|k| b(e / n, k) * b(e % n, k)).sum::<f64>()).collect();
            (0..n).for_each(|i| a[i * n + i] += 0.1);
            let x: Vec<f64> = (0..n).map(|i| i as f64 - 2.5).collect();
            let mut rhs: Vec<f64> = (0..n).map(|i| dot(&a[i * n..(i + 1) * n], &x)).collect();
            factor(&mut a, n);
            solve(&a, n, &mut rhs);
            assert!(rhs.iter().zip(&x).all(|(a, b)| (a - b).abs() < 1e-10), "{n}: {rhs:?}");
        }
    }
}
