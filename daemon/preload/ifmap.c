/* SPDX-License-Identifier: MIT
 *
 * ifmap.c - the CAN interfaces that a preloaded program sees.
 */
#include "preload/ifmap.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static iface ifaces[IFMAP_MAX];
static int count;

/* Copies a field up to one of the ends. Returns what is behind it, NULL when it is too long. */
static const char *take_field(char *out, size_t room, const char *text, const char *ends)
{
    const size_t length = strcspn(text, ends);
    if (length >= room)
        return NULL;
    memcpy(out, text, length);
    out[length] = '\0';
    return text + length;
}

/* Steps over the tab behind a field. */
static const char *next_field(const char *text)
{
    return text && *text == '\t' ? text + 1 : NULL;
}

/* Takes the names of an interface, with commas between them. Returns the text behind them, or
 * NULL. */
static const char *take_names(iface *in, const char *text)
{
    for (int i = 0; text && i < IFMAP_NAMES_MAX; i++) {
        text = take_field(in->names[i], sizeof in->names[i], text, ",\t\n");
        if (!text || *text != ',')
            return text;
        text++;
    }
    return NULL;
}

/* Reads one line. Returns what is behind it, NULL when it is not one. */
static const char *ifmap_take_line(iface *in, const char *text)
{
    char mtu[8] = "", kind[8] = "";
    text = next_field(take_names(in, text));
    text = text ? next_field(take_field(mtu, sizeof mtu, text, "\t\n")) : NULL;
    text = text ? next_field(take_field(kind, sizeof kind, text, "\t\n")) : NULL;
    text = text ? next_field(take_field(in->node, sizeof in->node, text, "\t\n")) : NULL;
    text = text ? take_field(in->path, sizeof in->path, text, "\n") : NULL;
    in->mtu = atoi(mtu);
    in->guest = strcmp(kind, "guest") == 0;
    return text;
}

void ifmap_read(void)
{
    const char *text = getenv(IFMAP_VARIABLE);
    while (text && *text && count < IFMAP_MAX) {
        iface *in = &ifaces[count];
        text = ifmap_take_line(in, text);
        if (!text) {
            (void)fprintf(stderr, "libcanwire-socketcan: " IFMAP_VARIABLE " cannot be read\n");
            return;
        }
        in->index = IFMAP_BASE + count;
        count++;
        text += *text == '\n';
    }
}

int ifmap_count(void)
{
    return count;
}

const iface *ifmap_at(int i)
{
    return &ifaces[i];
}

const iface *ifmap_of_index(int index)
{
    const int i = index >= IFMAP_BASE ? index - IFMAP_BASE : -1;
    return i >= 0 && i < count ? &ifaces[i] : NULL;
}

const iface *ifmap_of_name(const char *name)
{
    for (int i = 0; i < count; i++)
        for (int k = 0; k < IFMAP_NAMES_MAX; k++)
            if (*ifaces[i].names[k] && strncmp(ifaces[i].names[k], name, IF_NAMESIZE) == 0)
                return &ifaces[i];
    return NULL;
}

int ifmap_number(const iface *in)
{
    return in->index - IFMAP_BASE;
}
