%% begin
$header
#ifndef ${name}_h
#define ${name}_h

#include <math.h>

/* Moduli of the material from which this file was written. */
static const double ${name}_shear_modulus = $shear_modulus;
%% space
static const double ${name}_bulk_modulus = $bulk_modulus;

/* Volumetric energy U(J3) and its two derivatives, in units of the shear modulus; K is the ratio of bulk and shear modulus. */
static inline void ${name}_volumetric(double J3, double K, double U[3])
{
$volumetric
}

%% law
/* Isochoric energy W(I1, I2) in units of the shear modulus, and its derivatives W1, W2, W11, W12, W22. */
static inline void ${name}_isochoric(double I1, double I2, double W[6])
{
$isochoric
}

%% network
/* Activation function of the hidden units, and its two derivatives. */
static inline void ${name}_activation(double x, double a[3])
{
$activation
}

/* Weights of both features, biases and output weights of the hidden units. */
static const double ${name}_units[$n_units][4] = {
$units
};

%% isochoric network
/* Isochoric energy W(I1, I2) in units of the shear modulus, and its derivatives W1, W2, W11, W12, W22. */
static inline void ${name}_isochoric(double I1, double I2, double W[6])
{
    const double p = log(I1 / 3.0), q = log(I2 / 3.0);
    double sums[6] = {-($at_rest), 0.0, 0.0, 0.0, 0.0, 0.0}, a[3];
    for (int k = 0; k < $n_units; k++) {
        const double *w = ${name}_units[k];
        ${name}_activation(w[0] * p + w[1] * q + w[2], a);
        sums[0] += w[3] * a[0];
        sums[1] += w[3] * w[0] * a[1];
        sums[2] += w[3] * w[1] * a[1];
        sums[3] += w[3] * w[0] * w[0] * a[2];
        sums[4] += w[3] * w[0] * w[1] * a[2];
        sums[5] += w[3] * w[1] * w[1] * a[2];
    }
    W[0] = sums[0];
    W[1] = sums[1] / I1;
    W[2] = sums[2] / I2;
    W[3] = (sums[3] - sums[1]) / (I1 * I1);
    W[4] = sums[4] / (I1 * I2);
    W[5] = (sums[5] - sums[2]) / (I2 * I2);
}

%% invariants
/* W at isochoric log-stretches x, its derivatives g by x, and its second derivatives h along the axes, at constant volume. */
static inline double ${name}_at_stretches(const double x[3], double g[3], double h[3])
{
    double s[3], W[6], I1 = 0.0, I2 = 0.0;
    for (int a = 0; a < 3; a++) {
        s[a] = exp(2.0 * x[a]);
        I1 += s[a];
        I2 += 1.0 / s[a];
    }
    ${name}_isochoric(I1, I2, W);
    for (int a = 0; a < 3; a++) {
        const double d1 = 2.0 * (s[a] - I1 / 3.0), d2 = -2.0 * (1.0 / s[a] - I2 / 3.0);
        g[a] = 2.0 * (W[1] * s[a] - W[2] / s[a]);
        h[a] = 4.0 / 9.0 * (W[1] * (3.0 * s[a] + I1) + W[2] * (3.0 / s[a] + I2));
        h[a] += W[3] * d1 * d1 + 2.0 * W[4] * d1 * d2 + W[5] * d2 * d2;
    }
    return W[0];
}

%% stretches
/* Constants of the terms of W. */
static const double ${name}_terms[$n_terms][$n_constants] = {
$terms
};

/* A term of W at isochoric log-stretches x and their squares s: W, its derivatives by x, second derivative along axis 3. */
static inline void ${name}_term(double x1, double x2, double x3, double s1, double s2, double s3, const double *c, double W[5])
{
$term
}

/* W at isochoric log-stretches x, its derivatives g by x, and its second derivatives h along the axes, at constant volume. */
static inline double ${name}_at_stretches(const double x[3], double g[3], double h[3])
{
    double s[3], W[5], sum = 0.0;
    for (int a = 0; a < 3; a++) {
        s[a] = exp(2.0 * x[a]);
        g[a] = h[a] = 0.0;
    }
    for (int k = 0; k < $n_terms; k++) {
        for (int c = 0; c < 3; c++) {
            const int a = (c + 1) % 3, b = (c + 2) % 3;
            ${name}_term(x[a], x[b], x[c], s[a], s[b], s[c], ${name}_terms[k], W);
            h[c] += W[4];
        }
        for (int a = 0; a < 3; a++)
            g[a] += W[1 + a];
        sum += W[0];
    }
    return sum;
}

%% space
/* Energy at log-stretches e, its derivatives t by e (principal Kirchhoff stresses) and H, in units of the shear modulus. */
static inline double ${name}_principal(const double e[3], double K, double t[3], double H[3][3])
{
    double x[3], g[3], h[3], U[3], J, W;
    const double third = (e[0] + e[1] + e[2]) / 3.0;
    for (int a = 0; a < 3; a++)
        x[a] = e[a] - third;
    W = ${name}_at_stretches(x, g, h);
    J = exp(3.0 * third);
    ${name}_volumetric(J, K, U);
    for (int a = 0; a < 3; a++) {
        t[a] = g[a] - (g[0] + g[1] + g[2]) / 3.0 + J * U[1];
        for (int b = 0; b < 3; b++)
            H[a][b] = (a == b ? h[a] : (h[3 - a - b] - h[a] - h[b]) / 2.0) + J * (U[1] + J * U[2]);
    }
    return W + U[0];
}

%% sheet
/* Energy of the sheet at in-plane log-stretches e, its derivatives t by e and H, in units of the shear modulus. */
static inline double ${name}_principal(const double e[2], double t[2], double H[2][2])
{
    const double d = e[0] - e[1], th = tanh(d), flat = $flat;
    const double p = e[0] + e[1], q = log(cosh(d));
    double sums[6] = {-($at_rest) - flat * p, -flat, 0.0, 0.0, 0.0, 0.0}, a[3], steep;
    for (int k = 0; k < $n_units; k++) {
        const double *w = ${name}_units[k];
        ${name}_activation(w[0] * p + w[1] * q + w[2], a);
        sums[0] += w[3] * a[0];
        sums[1] += w[3] * w[0] * a[1];
        sums[2] += w[3] * w[1] * a[1];
        sums[3] += w[3] * w[0] * w[0] * a[2];
        sums[4] += w[3] * w[0] * w[1] * a[2];
        sums[5] += w[3] * w[1] * w[1] * a[2];
    }
    t[0] = sums[1] + sums[2] * th;
    t[1] = sums[1] - sums[2] * th;
    steep = sums[5] * th * th + sums[2] * (1.0 - th * th);
    H[0][0] = sums[3] + 2.0 * sums[4] * th + steep;
    H[1][1] = sums[3] - 2.0 * sums[4] * th + steep;
    H[0][1] = H[1][0] = sums[3] - steep;
    return sums[0];
}

%% end
/* Log-stretches e, principal directions N (columns) and det F, by Jacobi's method for the eigenvalues of F^T F. */
static inline double ${name}_stretches(const double F[$dd], double e[$d], double N[$d][$d])
{
    double C[$d][$d];
    for (int i = 0; i < $d; i++)
        for (int j = 0; j < $d; j++) {
            C[i][j] = 0.0;
            N[i][j] = i == j;
            for (int k = 0; k < $d; k++)
                C[i][j] += F[$d * k + i] * F[$d * k + j];
        }
    for (int sweep = 0; sweep < 20; sweep++)
        for (int p = 0; p < $d; p++)
            for (int q = p + 1; q < $d; q++) {
                if (fabs(C[p][q]) <= 1e-17 * sqrt(C[p][p] * C[q][q]))
                    continue;
                const double ratio = (C[q][q] - C[p][p]) / (2.0 * C[p][q]);
                const double t = copysign(1.0, ratio) / (fabs(ratio) + sqrt(1.0 + ratio * ratio));
                const double c = 1.0 / sqrt(1.0 + t * t), s = t * c;
                for (int k = 0; k < $d; k++) {
                    const double kp = C[k][p], kq = C[k][q];
                    C[k][p] = c * kp - s * kq;
                    C[k][q] = s * kp + c * kq;
                }
                for (int k = 0; k < $d; k++) {
                    const double pk = C[p][k], qk = C[q][k], np = N[k][p], nq = N[k][q];
                    C[p][k] = c * pk - s * qk;
                    C[q][k] = s * pk + c * qk;
                    N[k][p] = c * np - s * nq;
                    N[k][q] = s * np + c * nq;
                }
            }
    for (int a = 0; a < $d; a++)
        e[a] = log(C[a][a]) / 2.0;
%% space
    return F[0] * (F[4] * F[8] - F[5] * F[7]) - F[1] * (F[3] * F[8] - F[5] * F[6]) + F[2] * (F[3] * F[7] - F[4] * F[6]);
%% sheet
    return F[0] * F[3] - F[1] * F[2];
%% end
}

/* Energy density; first Piola-Kirchhoff stress P and tangent A = dP/dF unless they are null. NaN unless det F > 0. */
static inline double ${name}_evaluate(const double F[$dd], $moduli, double *P, double *A)
{
    double e[$d], N[$d][$d], n[$d][$d], t[$d], H[$d][$d], energy, stretch[$d];
    const double J = ${name}_stretches(F, e, N);
%% space
    energy = ${name}_principal(e, bulk_modulus / shear_modulus, t, H);
%% sheet
    energy = ${name}_principal(e, t, H);
%% end
    for (int a = 0; a < $d; a++) {
        stretch[a] = J > 0.0 ? exp(e[a]) : NAN;
        for (int i = 0; i < $d; i++) {
            n[i][a] = 0.0;
            for (int k = 0; k < $d; k++)
                n[i][a] += F[$d * i + k] * N[k][a] / stretch[a];
        }
    }
    for (int m = 0; P && m < $dd; m++) {
        P[m] = 0.0;
        for (int a = 0; a < $d; a++)
            P[m] += shear_modulus * t[a] / stretch[a] * n[m / $d][a] * N[m % $d][a];
    }
    for (int m = 0; A && m < $dd * $dd; m++) {
        const int i = m / ($d * $dd), j = m / $dd % $d, k = m / $d % $d, l = m % $d;
        A[m] = 0.0;
        for (int a = 0; a < $d; a++)
            for (int b = 0; b < $d; b++) {
                const double both = stretch[a] * stretch[b];
                A[m] += shear_modulus * (H[a][b] - (a == b ? t[a] : 0.0)) / both * n[i][a] * N[j][a] * n[k][b] * N[l][b];
                if (a != b) {
                    const double sa = stretch[a] * stretch[a], sb = stretch[b] * stretch[b];
                    /* Slope of the stress over the squared stretches, and its limit for equal ones. */
                    const double slope = fabs(e[a] - e[b]) > 1e-5 ? (t[a] - t[b]) / (sa - sb) : (H[a][a] + H[b][b] - 2.0 * H[a][b]) / (4.0 * both);
                    A[m] += shear_modulus * n[i][a] * N[j][b] * (slope * n[k][a] * N[l][b] + (sb * slope - t[b]) / both * n[k][b] * N[l][a]);
                }
            }
    }
    return J > 0.0 ? shear_modulus * energy : NAN;
}

static inline double ${name}_energy(const double F[$dd], $moduli)
{
    return ${name}_evaluate(F, $pass, 0, 0);
}

static inline void ${name}_stress(const double F[$dd], $moduli, double P[$dd])
{
    ${name}_evaluate(F, $pass, P, 0);
}

static inline void ${name}_tangent(const double F[$dd], $moduli, double A[$ddd])
{
    ${name}_evaluate(F, $pass, 0, A);
}

%% network
/* 1 if the principal stretches lie within the domain in which the energy was learned, else 0. */
static inline int ${name}_inside(const double F[$dd])
{
    double e[$d], N[$d][$d], volume = 0.0;
    int inside = ${name}_stretches(F, e, N) > 0.0;
%% isochoric network
    volume = (e[0] + e[1] + e[2]) / 3.0;
%% network
    for (int a = 0; a < $d; a++)
        inside = inside && exp(e[a] - volume) >= $least && exp(e[a] - volume) <= $greatest;
    return inside;
}

%% check
/* Compile with -D${name}_check for a program that compares energies and stresses with those of pdsurrogate. */
#ifdef ${name}_check
#include <stdio.h>

/* Rows: F, energy density, P. */
static const double ${name}_states[$n_states][$n_numbers] = {
$states
};

int main(void)
{
    double P[$dd], deviation = 0.0;
    for (int k = 0; k < $n_states; k++) {
        const double *row = ${name}_states[k];
        const double energy = ${name}_evaluate(row, $defaults, P, 0);
        deviation = fmax(deviation, fabs(energy - row[$dd]));
        for (int m = 0; m < $dd; m++)
            deviation = fmax(deviation, fabs(P[m] - row[$dd + 1 + m]));
        if (isnan(energy))
            deviation = INFINITY;
    }
    printf("greatest deviation %.1e, allowed %.1e\n", deviation, $allowed);
    return deviation <= $allowed ? 0 : 1;
}
#endif

#endif
