/* Inertia of another joint's motor: c ddq_motor_p. shape: partner p. */
static inline void dynid_inertial_coupling(const double *shape, int j, const dynid_input *x, double *memory, double *columns)
{
    (void)j, (void)memory;
    columns[0] = shape[0] >= 0.0 ? x->ddq_motor[(int)shape[0]] : 0.0;
}
