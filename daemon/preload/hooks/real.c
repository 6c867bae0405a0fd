/* SPDX-License-Identifier: MIT
 *
 * real.c - finds the calls of the C library behind this one.
 */
#include "preload/hooks/real.h"

#include <dlfcn.h>
#include <stddef.h>
#include <string.h>

real_calls real_found;
bool real_is_found;

#define REAL_NAME(result, name, parameters) {#name, offsetof(real_calls, name)},

static const struct {
    const char *name;
    size_t offset;
} calls[] = {REAL_CALLS(REAL_NAME)};

/* Two threads that come here at once write the same. An old C library lacks some of them. */
void real_find(void)
{
    for (size_t i = 0; i < sizeof calls / sizeof *calls; i++) {
        void *found = dlsym(RTLD_NEXT, calls[i].name);
        memcpy((char *)&real_found + calls[i].offset, &found, sizeof found);
    }
    __atomic_store_n(&real_is_found, true, __ATOMIC_RELEASE);
}
