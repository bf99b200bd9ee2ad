/* Friction that grows with the load of the gear: (m0 + m1 |v|) |tau_link| s(v). shape: eps. */
static inline void dynid_load_dependent_friction(const double *shape, int j, const dynid_input *x, double *memory, double *columns)
{
    double dq = x->dq_motor[j];
    (void)memory;
    columns[0] = fabs(x->tau_link[j]) * dynid_friction_sign(dq, shape[0], shape[1]);
    columns[1] = columns[0] * fabs(dq);
}
