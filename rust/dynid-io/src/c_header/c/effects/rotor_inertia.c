/* J ddq_motor: inertia of the rotor. */
static inline void dynid_rotor_inertia(const double *shape, int j, const dynid_input *x, double *memory, double *columns)
{
    (void)shape, (void)memory;
    columns[0] = x->ddq_motor[j];
}
