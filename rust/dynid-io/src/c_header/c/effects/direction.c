/* Direction of motion, smooth at standstill. */
static inline double dynid_direction(double dq, double eps)
{
    return tanh(dq / eps);
}
