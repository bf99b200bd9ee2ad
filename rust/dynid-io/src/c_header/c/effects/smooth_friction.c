/* Friction with the sign s = v / (|v|^p + e^p)^(1/p): s, |s|, v, |v|, v |v|, v^2. shape: e, p. */
static inline void dynid_smooth_friction(const double *shape, int j, const dynid_input *x, double *memory, double *columns)
{
    double v = x->dq_motor[j], size = fabs(v), s = dynid_friction_sign(v, shape[0], shape[1]);
    (void)memory;
    columns[0] = s;
    columns[1] = fabs(s);
    columns[2] = v;
    columns[3] = size;
    columns[4] = v * size;
    columns[5] = v * v;
}
