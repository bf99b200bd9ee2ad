/* A cylinder of gas between two pins: c / (s - stroke) dL/dq, L^2 = a^2 + b^2 + 2 a b cos(q + phase).
 * shape: a, b, phase, gas length s. */
static inline void dynid_counterbalance(const double *shape, int j, const dynid_input *x, double *memory, double *columns)
{
    double a = shape[0], b = shape[1], angle = x->q[j] + shape[2];
    double length = sqrt(a * a + b * b + 2.0 * a * b * cos(angle));
    double lever_arm = -a * b * sin(angle) / length;
    double stroke = length - fabs(a - b);
    (void)memory;
    columns[0] = lever_arm / (shape[3] - stroke);
}
