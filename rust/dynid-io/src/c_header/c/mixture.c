/* Gaussian mixture regression of k components on d inputs, in logs. A component is log(weight / |L|), output mean,
 * output variance given the inputs, then d input means, d gains, and the rows of the inverse of L, the lower triangular
 * root of the inputs' covariance. */
static inline dynid_prediction dynid_mixture(const double *component, int k, int d, const double *u)
{
    dynid_prediction p = {0.0, 0.0, HUGE_VAL};
    double best = -HUGE_VAL, total = 0.0, spread = 0.0;
    int i, r, c;
    for (i = 0; i < k; i++) {
        const double *input_mean = component + 3, *gain = input_mean + d, *row = gain + d;
        double distance_squared = 0.0, mean = component[1], log_wp, h, step;
        for (r = 0; r < d; r++) {
            double z = -0.0;
            for (c = 0; c <= r; c++) {
                z += *row++ * (u[c] - input_mean[c]);
            }
            distance_squared += z * z;
            mean += gain[r] * z;
        }
        p.distance_squared = fmin(p.distance_squared, distance_squared);
        log_wp = fmax(component[0] - 0.5 * distance_squared, -DBL_MAX);
        if (log_wp > best) {
            double shrink = exp(best - log_wp);
            total *= shrink;
            spread *= shrink;
            best = log_wp;
        }
        h = exp(log_wp - best);
        total += h;
        step = mean - p.mean;
        p.mean += step * (h / total);
        spread += h * (component[2] + step * (mean - p.mean));
        component = row;
    }
    p.variance = fmax(spread / total, 0.0);
    return p;
}
