/* A torque constant that droops at high current: c tau_motor^3. */
static inline void dynid_torque_saturation(const double *shape, int j, const dynid_input *x, double *memory, double *columns)
{
    double tau = x->tau_motor[j];
    (void)shape, (void)memory;
    columns[0] = tau * tau * tau;
}
