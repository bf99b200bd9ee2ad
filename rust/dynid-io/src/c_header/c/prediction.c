/* Answer of a regression: mean, variance, squared distance from its data. */
typedef struct {
    double mean, variance, distance_squared;
} dynid_prediction;

/* Torque and variance of a joint from its regression on d inputs; 1 if it was asked so far from its data that its torque
 * was faded: fully trusted up to 4 widths, not at all from 6 on, and a quarter more of both for every further input. */
static inline int dynid_trust(const dynid_prediction *p, int d, double second_moment, double *tau, double *variance)
{
    double distance = sqrt(p->distance_squared), further = 0.25 * ((double)d - 2.0);
    double near = 4.0 + further, far = 6.0 + further, trust = 0.0;
    if (distance <= near) {
        trust = 1.0;
    } else if (distance < far) {
        trust = (far - distance) / (far - near);
    }
    *variance = (1.0 - trust) * (*variance + second_moment);
    *tau = 0.0;
    if (trust > 0.0) {
        *tau = trust * p->mean;
        *variance += trust * p->variance;
    }
    *variance = fmin(*variance, 1e300);
    return trust < 1.0;
}
