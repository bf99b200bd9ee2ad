/* Friction with the sign s = v / (|v|^p + e^p)^(1/p): s, |s|, v, |v|, v |v|, v^2. shape: e, p. */
static inline void dynid_smooth_friction(const double *shape, int j, const dynid_input *x, double *memory, double *columns)
{
    double v = x->dq_motor[j], size = fabs(v), part = 1.0, ratio, s;
    (void)memory;
    if (size < shape[0]) {
        ratio = part = size / shape[0];
    } else {
        ratio = shape[0] / size;
    }
    part *= pow(1.0 + pow(ratio, shape[1]), -1.0 / shape[1]);
    s = v < 0.0 ? -part : part;
    columns[0] = s;
    columns[1] = part;
    columns[2] = v;
    columns[3] = size;
    columns[4] = v * size;
    columns[5] = v * v;
}
