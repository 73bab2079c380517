/* The choice of labels that a picture shows. */
#pragma once

#include "host.h"

/* Choose labels in their order: those that neither overlap one placed before nor are near an equal one. */
HOST void choose_labels(
    int64_t candidates, int64_t labels, const int64_t order[restrict candidates],
    const double box[restrict labels][4], /* west, south, east, north: px */
    const int64_t label[restrict labels], /* equal for anchors of one label */
    const int8_t state[restrict labels], /* 2: shown already, 1: fades out there, 0: neither */
    int64_t most_shown,
    double margin, /* between a label that appears and others, px */
    double repeat, /* between the middles of equal labels, half of it once they are shown, px */
    bool chosen[restrict labels],
    int64_t placed[restrict candidates]); /* scratch */
