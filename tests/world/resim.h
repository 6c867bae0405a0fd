/* SPDX-License-Identifier: MIT
 *
 * resim.h - a journal once more, by the tool's own code, outside of the world's time.
 */
#ifndef CANWIRE_TESTS_WORLD_RESIM_H
#define CANWIRE_TESTS_WORLD_RESIM_H

#include <stdbool.h>

typedef struct resim {
    bool crashed;
    int status;
    char *events;
    char *errors;
} resim;

void resim_run(resim *run, const char *journal);
void resim_free(resim *run);

#endif
