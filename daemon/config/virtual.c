/* SPDX-License-Identifier: MIT
 *
 * virtual.c - the keys of `virtual`: the programs whose waits move the time of a bus.
 */
#include "config/parts.h"

#include "config/node/portname.h"
#include "config/source.h"
#include "config/values.h"

#include <string.h>

static schema_reader read_socket;

static const schema_range programs_range = {1, CFG_PROGRAMS_MAX, sizeof(uint8_t)};

const schema_key cfg_virtual_keys[] = {
    {.name = "programs", .read = schema_read_uint,
     .offset = offsetof(cfg, virtual_time.programs), .arg = &programs_range,
     .preset = "1",
     .help = "How many programs of canwire run --virtual must be there before time begins."},
    {.name = "until", .read = cfg_read_ticks_min, .offset = offsetof(cfg, virtual_time.until),
     .help = "Bus time at which time stands still: the run is over."},
    {.name = "socket", .read = read_socket, .type = "text",
     .help = "Path of the socket at which programs join virtual time, relative to this file; "
             "default: that of control with .time behind it."},
    {.name = NULL},
};

/* Reads the path of the socket of time, which is relative to the configuration. */
static void read_socket(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg *config = object;
    const char *text = schema_text(self, key, value, "the path of a socket");
    if (text)
        config->virtual_time.socket = cfg_resolve_path(self, config->file, text);
}

/* Complains also without `pacing: virtual`: the keys would do nothing then. */
void cfg_read_virtual(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg *config = object;
    config->virtual_time.place = cfg_place_of(value);
    if (config->pacing != CFG_PACING_VIRTUAL)
        schema_complain(self, value, "%s: only a bus with 'pacing: virtual' has it", key->name);
    schema_map(self, key->name, value, cfg_virtual_keys, config);
}

/* Returns true for a path that a socket can have. */
static bool virtual_fits(const char *path)
{
    return strlen(path) <= PORTNAME_PATH_MAX;
}

void cfg_complete_virtual(schema *self, yaml_node_t *root, cfg *config)
{
    cfg_virtual *v = &config->virtual_time;
    if (config->pacing != CFG_PACING_VIRTUAL)
        return;
    const yaml_node_t *at = schema_find(self, root, "virtual");
    if (!at)
        at = schema_find(self, root, "pacing");
    v->place = cfg_place_of(at);
    if (v->programs == 0)
        v->programs = 1;
    if (!v->socket && !config->control)
        schema_complain(self, at, "virtual: socket: expected the path of a socket, at which "
                        "programs join; with 'control' it is that path with .time behind it. A "
                        "campaign needs none: it has 'virtual: on' beside 'ecu'");
    else if (!v->socket)
        v->socket = schema_print(self, "%s.time", config->control);
    if (v->socket && !virtual_fits(v->socket))
        schema_complain(self, at, "virtual: socket: the path of a socket has at most %u bytes, not "
                        "%zu (%s)", PORTNAME_PATH_MAX, strlen(v->socket), v->socket);
}
