/* A sum over all samples.
   @needs bits
   @header */
typedef struct {
    double sum;
} mrd_running_sum;
/* @source */
static void mrd_running_sum_begin(mrd_running_sum *s) {
    s->sum = 0.0;
}

static void mrd_running_sum_add(mrd_running_sum *s, double value) {
    s->sum = s->sum + value;
}
