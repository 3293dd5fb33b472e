//! Small dense kernels on slices (row-major): sizes are known only at run time and too small for a library's blocking.

use nalgebra::Vector6;

/// Rotation, then translation; or torque, then force.
pub type Spatial = Vector6<f64>;

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
#[cfg(test)]
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

/// Rows in whole vectors are multiples of this many numbers long.
pub const LANES: usize = 4;
/// As many numbers, of which one operation is done at once.
pub type Lanes = [f64; LANES];

/// [`dot`] of rows in whole vectors.
#[inline(always)]
pub fn dot_lanes(x: &[f64], y: &[f64]) -> f64 {
    dots_lanes([x], y)[0]
}

/// [`dot_lanes`] of several rows with one, side by side: no sum waits for another.
#[inline(always)]
pub fn dots_lanes<const D: usize>(rows: [&[f64]; D], y: &[f64]) -> [f64; D] {
    let y = y.as_chunks::<LANES>().0;
    let n = rows.iter().fold(y.len(), |n, row| n.min(row.len() / LANES));
    let (rows, y) = (rows.map(|row| &row.as_chunks::<LANES>().0[..n]), &y[..n]);
    let mut strands = [[0.0; LANES]; D];
    for c in 0..n {
        for d in 0..D {
            for k in 0..LANES {
                strands[d][k] += rows[d][c][k] * y[c][k];
            }
        }
    }
    // stored once: the compiler makes vectors of what is stored together, and of a sum of four numbers it does not
    std::hint::black_box(strands).map(|sum| (sum[0] + sum[2]) + (sum[1] + sum[3]))
}

/// [`axpy`] of rows in whole vectors.
#[inline(always)]
pub fn axpy_lanes(a: f64, x: &[f64], y: &mut [f64]) {
    let (x, y) = (x.as_chunks::<LANES>().0, y.as_chunks_mut::<LANES>().0);
    let n = x.len().min(y.len());
    let (x, y) = (&x[..n], &mut y[..n]);
    for c in 0..n {
        // a copy: written in place, each number might change the next of `x` for all that the compiler knows
        let mut sum = y[c];
        for k in 0..LANES {
            sum[k] += a * x[c][k];
        }
        y[c] = sum;
    }
}

/// Lower Cholesky factor in place, row-major, of a symmetric matrix that is at least the identity; the lower triangle is
/// read and replaced.
#[inline(always)]
pub fn cholesky(a: &mut [f64], n: usize) {
    for i in 0..n {
        let (above, rest) = a.split_at_mut(i * n);
        let row = &mut rest[..n];
        for j in 0..i {
            let other = &above[j * n..j * n + j + 1];
            row[j] = (row[j] - dot(&row[..j], &other[..j])) / other[j];
        }
        row[i] = (row[i] - dot(&row[..i], &row[..i])).max(f64::MIN_POSITIVE).sqrt();
    }
}

/// Solves `L L' x = b` in place.
#[inline(always)]
pub fn cholesky_backsolve(l: &[f64], n: usize, b: &mut [f64]) {
    for j in 0..n {
        b[j] = (b[j] - dot(&l[j * n..j * n + j], &b[..j])) / l[j * n + j];
    }
    for j in (0..n).rev() {
        b[j] /= l[j * n + j];
        let x = b[j];
        axpy(-x, &l[j * n..j * n + j], &mut b[..j]);
    }
}

/// Largest negative or zero pivot, relative to the largest diagonal, that counts as zero.
const RANK_TOLERANCE: f64 = 1e-14;

/// Lower factor, row-major into `l`, of the positive semidefinite n x n matrix with these entries; a pivot that rounding
/// makes zero or less gives a column of zeros.
pub fn semidefinite_factor(n: usize, entry: impl Fn(usize, usize) -> f64, l: &mut [f64]) {
    let floor = RANK_TOLERANCE * (0..n).map(|i| entry(i, i)).fold(0.0, f64::max);
    for i in 0..n {
        let (above, rest) = l.split_at_mut(i * n);
        let row = &mut rest[..n];
        for j in 0..i {
            let other = &above[j * n..j * n + j + 1];
            row[j] = if other[j] > 0.0 { (entry(i, j) - dot(&row[..j], &other[..j])) / other[j] } else { 0.0 };
        }
        let pivot = entry(i, i) - dot(&row[..i], &row[..i]);
        row[i] = if pivot > floor { pivot.sqrt() } else { 0.0 };
        row[i + 1..].fill(0.0);
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::needless_range_loop)]
    use super::*;

    /// A matrix of rank `rank`, at least the identity if `shift` is one.
    fn gram(n: usize, rank: usize, shift: f64) -> Vec<f64> {
        let row = |i: usize| -> Vec<f64> { (0..rank).map(|k| ((i * 5 + k * 3) as f64 * 1.7).sin()).collect() };
        (0..n * n).map(|ij| dot(&row(ij / n), &row(ij % n)) + if ij % (n + 1) == 0 { shift } else { 0.0 }).collect()
    }

    #[test]
    fn cholesky_solves_what_was_multiplied() {
        let n = 7;
        let a = gram(n, 5, 1.0);
        let x: Vec<f64> = (0..n).map(|i| i as f64 - 1.5).collect();
        let mut b: Vec<f64> = (0..n).map(|i| dot(&a[i * n..(i + 1) * n], &x)).collect();
        let mut l = a;
        cholesky(&mut l, n);
        cholesky_backsolve(&l, n, &mut b);
        assert!(b.iter().zip(&x).all(|(a, b)| (a - b).abs() < 1e-12));
    }

    #[test]
    fn a_semidefinite_factor_gives_the_matrix_back() {
        for rank in 1..=6 {
            let n = 6;
            let a = gram(n, rank, 0.0);
            let mut l = vec![f64::NAN; n * n];
            semidefinite_factor(n, |i, j| a[i * n + j], &mut l);
            for i in 0..n {
                for j in 0..n {
                    let product = dot(&l[i * n..(i + 1) * n], &l[j * n..(j + 1) * n]);
                    assert!((product - a[i * n + j]).abs() < 1e-6, "rank {rank}: {product} for {}", a[i * n + j]);
                }
            }
        }
    }

    #[test]
    fn rows_in_whole_vectors_are_as_any_other() {
        let x: Vec<f64> = (0..16).map(|i| (i as f64).sin()).collect();
        let y: Vec<f64> = (0..16).map(|i| (i as f64).cos()).collect();
        assert!((dot_lanes(&x, &y) - dot(&x, &y)).abs() < 1e-15);
        let (mut a, mut b) = (y.clone(), y);
        axpy(0.3, &x, &mut a);
        axpy_lanes(0.3, &x, &mut b);
        assert_eq!(a, b);
    }
}
