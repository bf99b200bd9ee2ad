/* Friction that changes as the gear warms up: f (c0 s(v) + c1 v), T df/dt = u - f, u = 1 or |v| / v_r, at most 10.
 * shape: T, v_r, eps, p. Memory: f. */
static inline void dynid_thermal_friction(const double *shape, int j, const dynid_input *x, double *memory, double *columns)
{
    double dq = x->dq_motor[j], warmth = memory[0];
    double source = shape[1] > 0.0 ? fmin(fabs(dq) / shape[1], 10.0) : 1.0;
    columns[0] = warmth * dynid_friction_sign(dq, shape[2], shape[3]);
    columns[1] = warmth * dq;
    memory[0] = warmth - (source - warmth) * expm1(-x->step / shape[0]);
}
