/* Bristles that bend over a distance until they slip, dz = dx/d (1 - z sign(dx)), along x. Memory: z, the place of the
 * sample before, and 1 from the first sample on. */
static inline double dynid_bristles(double distance, double x, double *memory)
{
    double z = memory[0], dx = memory[2] > 0.0 ? x - memory[1] : 0.0;
    double slip = dx == 0.0 ? 0.0 : copysign(1.0, dx);
    z = slip + (z - slip) * exp(-fabs(dx) / distance);
    memory[0] = z;
    memory[1] = x;
    memory[2] = 1.0;
    return z;
}
