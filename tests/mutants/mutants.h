/* SPDX-License-Identifier: MIT
 *
 * mutants.h - configurations that are nearly those that are shipped: a key, an item of a list or a
 * line is missing.
 */
#ifndef CANWIRE_TEST_MUTANTS_H
#define CANWIRE_TEST_MUTANTS_H

#include <stdbool.h>
#include <stddef.h>

#define WHAT_BYTES 100 /* of a text that says what is missing */

/* Gets a mutant; what: what is missing in it. */
typedef void mutant_taker(void *user, const char *text, size_t size, const char *what);

/* Leaves out each line, each key with its value and each item of each list of a YAML text, one at a
 * time. */
void mutants_of(const char *text, size_t size, mutant_taker *take, void *user);

/* The test of a configuration. */
typedef struct trial {
    const char *config;  /* path of the configuration */
    const char *mutated; /* path of the file that changes: the configuration, or its profile */
    const char *whole;   /* text of that file, with nothing missing */
    size_t whole_size;
    const char *folder;  /* every message begins with its name */
    bool is_rig;         /* of several buses: it is only checked */
} trial;

/* Tries this text in the file that changes, as `canwire check` and `canwire sim` would, and reloads
 * from the whole file to it and back. Ends the program with a message after a violation. Returns
 * true when the configuration is valid. */
bool try_files(const trial *t, const char *text, size_t size);

/* Ends the program. */
_Noreturn void fail(const char *why, const char *detail);

#endif
