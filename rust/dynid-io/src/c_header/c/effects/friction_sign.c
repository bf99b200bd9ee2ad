/* The sign of a speed as friction has it: v / (|v|^p + e^p)^(1/p), or tanh(v / e) where p is zero. */
static inline double dynid_friction_sign(double v, double e, double p)
{
    double size = fabs(v), part = 1.0, ratio;
    if (p <= 0.0) {
        return dynid_direction(v, e);
    }
    if (size < e) {
        ratio = part = size / e;
    } else {
        ratio = e / size;
    }
    part *= pow(1.0 + pow(ratio, p), -1.0 / p);
    return v < 0.0 ? -part : part;
}
