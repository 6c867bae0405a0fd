/* SPDX-License-Identifier: MIT
 *
 * unit.c - a bus in a program is not a service of systemd, whatever its environment says.
 */
#include "base/unit.h"

#include <stddef.h>

const char *unit_instance(void)
{
    return NULL;
}

const char *unit_hint(const char *path, int number)
{
    (void)path;
    (void)number;
    return "";
}

void unit_blame(int number)
{
    (void)number;
}
