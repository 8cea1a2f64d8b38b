/* Reads pairs of doubles from the file in.bin, and writes to out.bin, for each: sum, difference, product, quotient, the first one's bits
   as a number, and comparisons. */
#include <stdint.h>
#include <stdio.h>
#include <string.h>

int main(void) {
    FILE *in = fopen("in.bin", "rb"), *out = fopen("out.bin", "wb");
    double pair[2];
    if (in == NULL || out == NULL) {
        return 1;
    }
    while (fread(pair, sizeof pair, 1, in) == 1) {
        const double a = pair[0], b = pair[1];
        int64_t bits;
        double results[6];
        memcpy(&bits, &a, sizeof bits);
        results[0] = a + b;
        results[1] = a - b;
        results[2] = a * b;
        results[3] = a / b;
        results[4] = (double)bits;
        results[5] = (double)((a < b ? 1 : 0) + (a <= b ? 2 : 0) + (a > b ? 4 : 0) + (a >= b ? 8 : 0) + (a == b ? 16 : 0));
        if (fwrite(results, sizeof results, 1, out) != 1) {
            return 1;
        }
    }
    return fclose(out);
}
