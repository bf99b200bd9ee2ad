/* Friction that follows a measured temperature: c (T - T_0) F(v); nothing where it is not known.
 * shape: T_0, eps, p, the eight coefficients of F. */
static inline void dynid_temperature_friction(const double *shape, int j, const dynid_input *x, double *memory, double *columns)
{
    double above = (x->temperature ? x->temperature[j] : HUGE_VAL) - shape[0];
    (void)memory;
    columns[0] = 0.0;
    if (isfinite(above)) {
        double basis[8];
        dynid_friction_columns(dynid_friction_sign(x->dq_motor[j], shape[1], shape[2]), x->dq_motor[j], 0.0, basis);
        columns[0] = above * dynid_weigh(basis, shape + 3, 8);
    }
}
