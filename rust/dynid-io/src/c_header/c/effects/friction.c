/* Friction at the motor. shape: lambda, eps. */
static inline void dynid_friction(const double *shape, int j, const dynid_input *x, double *memory, double *columns)
{
    (void)memory;
    dynid_friction_columns(dynid_direction(x->dq_motor[j], shape[1]), x->dq_motor[j], shape[0], columns);
}
