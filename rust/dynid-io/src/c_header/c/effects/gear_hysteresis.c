/* Torque that an elastic gear loses while it winds up: k z along what its load leaves the spring. shape: change d within
 * which z turns round, load c that slipping teeth carry. Memory: z, the load of the sample before, and 1 from the first
 * sample on. */
static inline void dynid_gear_hysteresis(const double *shape, int j, const dynid_input *x, double *memory, double *columns)
{
    double z = memory[0], load = x->tau_link[j], change = memory[2] > 0.0 ? load - memory[1] : 0.0;
    double way = change == 0.0 ? 0.0 : copysign(1.0, change);
    double a = shape[1] * (1.0 - z * way) / shape[0], t = fabs(change) / shape[0], y = fmax(t / (1.0 + a), t - a);
    for (int step = 0; step < 8; step++) {
        double left = exp(-y), further = (t - y - a * (1.0 - left)) / (1.0 + a * left);
        if (further < 2.220446049250313e-16)
            break;
        y += further;
    }
    z = way + (z - way) * exp(-y);
    memory[0] = z;
    memory[1] = load;
    memory[2] = 1.0;
    columns[0] = z;
}
