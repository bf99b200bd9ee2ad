/* Friction that falls with speed: k s(v) exp(-(|v| / v_s)^d), k of the direction. shape: v_s, d, eps, p. */
static inline void dynid_stribeck(const double *shape, int j, const dynid_input *x, double *memory, double *columns)
{
    double dq = x->dq_motor[j], fall = exp(-pow(fabs(dq) / shape[0], shape[1]));
    (void)memory;
    columns[0] = columns[1] = 0.0;
    columns[dq < 0.0] = dynid_friction_sign(dq, shape[2], shape[3]) * fall;
}
