#include "labels.h"

void choose_labels(
    int64_t candidates, int64_t labels, const int64_t order[restrict candidates],
    const double box[restrict labels][4], const int64_t label[restrict labels],
    const int8_t state[restrict labels], int64_t most_shown, double margin, double repeat,
    bool chosen[restrict labels], int64_t placed[restrict candidates])
{
    int64_t count = 0, shown = 0;
    for (int64_t i = 0; i < labels; i++)
        chosen[i] = false;
    for (int64_t n = 0; n < candidates; n++) {
        int64_t i = order[n];
        bool fades = state[i] == 1, appears = state[i] == 0, is_free = true;
        if (!fades && shown == most_shown)
            continue;
        const double *a = box[i], room = appears ? margin : 0.0, reach = appears ? repeat : 0.5 * repeat;
        for (int64_t k = 0; k < count && is_free && !fades; k++) {
            const double *b = box[placed[k]];
            double apart = greatest(greatest(a[0] - b[2], b[0] - a[2]), a[1] - b[3]);
            apart = greatest(apart, b[1] - a[3]);
            double between = 0.5 * greatest(fabs(a[0] + a[2] - b[0] - b[2]), fabs(a[1] + a[3] - b[1] - b[3]));
            is_free = !(apart < room || (label[i] == label[placed[k]] && between < reach));
        }
        if (!is_free)
            continue;
        placed[count++] = i;
        chosen[i] = !fades;
        shown += !fades;
    }
}
