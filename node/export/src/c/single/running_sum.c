/* A sum over all samples. Its rounding error is carried along (W. Kahan, Commun. ACM 8 (1965) 40), so it grows although a sample adds little.
   @needs bits
   @header */
typedef struct {
    float sum, lost;
} mrd_running_sum;
/* @source */
static void mrd_running_sum_begin(mrd_running_sum *s) {
    s->sum = 0.0f;
    s->lost = 0.0f;
}

static void mrd_running_sum_add(mrd_running_sum *s, float value) {
    const float more = value - s->lost;
    const float next = s->sum + more;
    s->lost = (next - s->sum) - more;
    s->sum = next;
}
