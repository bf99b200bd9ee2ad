/* Columns of an effect times their coefficients. */
static inline double dynid_weigh(const double *columns, const double *coefficients, int n)
{
    double sum = -0.0;
    int k;
    for (k = 0; k < n; k++) {
        sum += columns[k] * coefficients[k];
    }
    return sum;
}
