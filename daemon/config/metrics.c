/* SPDX-License-Identifier: MIT
 *
 * metrics.c - the key `metrics`: where programs read the counters.
 */
#include "config/parts.h"

#include "config/node/portname.h"
#include "config/source.h"

#include <string.h>

#define METRICS_PORT 9464u /* that of OpenTelemetry's exporters */
#define UNIX "unix:"

static const char expected[] = "[HOST:]PORT or unix:PATH";

/* Takes the path of a socket, which is relative to the file. */
static void read_path(schema *self, const schema_key *key, const yaml_node_t *value, cfg *config,
                      const char *text)
{
    const char *path = cfg_resolve_path(self, config->file, text);
    if (!path)
        return;
    config->metrics.path = path;
    config->metrics.name = schema_print(self, UNIX "%s", path);
    if (strlen(path) > PORTNAME_PATH_MAX)
        schema_complain(self, value, "%s: the path of a socket has at most %u bytes, not %zu (%s)",
                        key->name, PORTNAME_PATH_MAX, strlen(path), path);
}

/* Takes an address, in its full form, so that equal ones have equal names. */
static void read_address(schema *self, const schema_key *key, const yaml_node_t *value,
                         cfg_metrics *out, const char *text)
{
    net_address address;
    char full[ADDRESS_BYTES];
    const size_t length = strlen(text);
    if (!address_parse(&address, text, length, METRICS_PORT)) {
        schema_complain(self, value, "%s: expected %s, with %s, not '%.40s'", key->name, expected,
                        address_expected(text, length), text);
        return;
    }
    const char *many = address_of_many(&address);
    if (many)
        schema_complain(self, value, "%s: %s is a %s address; expected that of one machine",
                        key->name, address.host, many);
    address_print(full, &address);
    out->name = schema_copy(self, full);
}

/* A port alone is one of the loopback: counters are not for the network unless the file says so. */
void cfg_read_metrics(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg *config = object;
    const char *text = schema_text(self, key, value, expected);
    config->metrics.place = cfg_place_of(value);
    if (!text)
        return;
    const portname name = portname_parse(text);
    if (name.kind == PORTNAME_UNIX)
        read_path(self, key, value, config, name.path);
    else
        read_address(self, key, value, &config->metrics, text);
}
