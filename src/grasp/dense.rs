//! Small dense kernels on slices (row-major): sizes are known only at run time and too small for a library's blocking.

/// `sum x_i y_i`
#[inline]
pub fn dot(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(a, b)| a * b).sum()
}

/// Euclidean norm.
pub fn norm(x: &[f64]) -> f64 {
    dot(x, x).sqrt()
}

/// `y += a x`
#[inline]
pub fn axpy(a: f64, x: &[f64], y: &mut [f64]) {
    for (y, x) in y.iter_mut().zip(x) {
        *y += a * x;
    }
}

/// Replaces the lower triangle of the symmetric positive definite `a` (n x n) by its Cholesky factor.
/// A pivot that rounding makes non-positive is raised to the smallest positive number: the callers' matrices are
/// bounded below by the identity.
pub fn cholesky(a: &mut [f64], n: usize) {
    for i in 0..n {
        for j in 0..=i {
            let (head, tail) = a.split_at(i * n);
            let row_i = &tail[..n];
            let sum = if i == j {
                row_i[i] - dot(&row_i[..i], &row_i[..i])
            } else {
                let row_j = &head[j * n..j * n + j + 1];
                (row_i[j] - dot(&row_i[..j], &row_j[..j])) / row_j[j]
            };
            a[i * n + j] = if i == j { sum.max(f64::MIN_POSITIVE).sqrt() } else { sum };
        }
    }
}

/// Solves `L x = b` in place.
pub fn solve_lower(l: &[f64], n: usize, b: &mut [f64]) {
    for i in 0..n {
        let row = &l[i * n..i * n + i + 1];
        b[i] = (b[i] - dot(&row[..i], &b[..i])) / row[i];
    }
}

/// Solves `L X = B` in place, `B` of n rows and `columns` columns.
pub fn solve_lower_many(l: &[f64], n: usize, b: &mut [f64], columns: usize) {
    for i in 0..n {
        let (done, rest) = b.split_at_mut(i * columns);
        let row = &mut rest[..columns];
        for j in 0..i {
            axpy(-l[i * n + j], &done[j * columns..(j + 1) * columns], row);
        }
        let inverse = 1.0 / l[i * n + i];
        for x in row {
            *x *= inverse;
        }
    }
}

/// Solves `L^T x = b` in place.
pub fn solve_upper(l: &[f64], n: usize, b: &mut [f64]) {
    for i in (0..n).rev() {
        b[i] /= l[i * n + i];
        let (head, tail) = b.split_at_mut(i);
        axpy(-tail[0], &l[i * n..i * n + i], head);
    }
}
