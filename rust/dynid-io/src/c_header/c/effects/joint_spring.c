/* A spring at the joint: k (q - q_0). shape: q_0. */
static inline void dynid_joint_spring(const double *shape, int j, const dynid_input *x, double *memory, double *columns)
{
    (void)memory;
    columns[0] = x->q[j] - shape[0];
}
