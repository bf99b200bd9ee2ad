/* A constant torque. */
static inline void dynid_torque_offset(const double *shape, int j, const dynid_input *x, double *memory, double *columns)
{
    (void)shape, (void)j, (void)x, (void)memory;
    columns[0] = 1.0;
}
