/* Normalised radial basis functions, k bumps over d inputs: centres row by row, precisions, weights, variances. */
static inline dynid_prediction dynid_rbf(const double *center, const double *precision, const double *weight,
                                         const double *variance, int k, int d, const double *u)
{
    dynid_prediction p = {0.0, 0.0, HUGE_VAL};
    double best = -HUGE_VAL, total = 0.0;
    int i, c;
    for (i = 0; i < k; i++) {
        double distance_squared = -0.0, log_psi, psi;
        for (c = 0; c < d; c++) {
            double off = u[c] - center[i * d + c];
            distance_squared += precision[c] * off * off;
        }
        p.distance_squared = fmin(p.distance_squared, distance_squared);
        log_psi = fmax(-0.5 * distance_squared, -DBL_MAX);
        if (log_psi > best) {
            double shrink = exp(best - log_psi);
            total *= shrink;
            p.mean *= shrink;
            p.variance *= shrink;
            best = log_psi;
        }
        psi = exp(log_psi - best);
        total += psi;
        p.mean += psi * weight[i];
        p.variance += psi * variance[i];
    }
    p.mean /= total;
    p.variance /= total;
    return p;
}
