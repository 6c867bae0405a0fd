/* SPDX-License-Identifier: MIT
 *
 * status.c - a running bus as JSON.
 */
#include "serve/status.h"

#include "base/text/jsonput.h"
#include "base/text/number.h"
#include "base/version.h"
#include "config/node/portname.h"
#include "record/data_timing.h"
#include "record/local_time.h"
#include "record/output.h"
#include "run/settings.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

void status_count(status_errors *errors, const cw_event *event)
{
    if (event->kind != CW_EVENT_ERROR)
        return;
    uint64_t *counters = event->error.role == CW_ROLE_TRANSMITTER ? errors->tx : errors->rx;
    for (unsigned i = 0; i < CW_NODES_MAX; i++)
        counters[i] += event->nodes >> i & 1u;
}

/* The names of link states; NULL: null. */
static const char *const link_names[] = {
    [REPORT_NO_LINK] = NULL,
    [REPORT_LINK_UP] = "up",
    [REPORT_LINK_DOWN] = "down",
    [REPORT_LINK_MISSING] = "missing",
};

static const char *const when_full_names[] = {
    [CFG_WHEN_FULL_DROP] = "drop",
    [CFG_WHEN_FULL_WAIT] = "wait",
};

#define PPB_PER_PERMILLE 1000000u
#define SAMPLE_POINT_MAX 16 /* bytes of "0.875" and of any 32 bits */

/* Puts the sample point as `ip` prints it: a part of 1, with three digits. */
static void put_sample_point(json_t *object, const char *key, const bit_timing *t)
{
    char text[SAMPLE_POINT_MAX];
    (void)snprintf(text, sizeof text, "0.%03" PRIu32,
                   timing_sample_point_ppb(t) / PPB_PER_PERMILLE);
    put_text(object, key, text);
}

/* Returns the bit timing that the node has now. */
static json_t *timing_json(const cfg *config, unsigned node, const cw_bit_timing *now)
{
    json_t *object = json_object();
    bit_timing t;
    int64_t ppm;
    cfg_timing_now(&t, &ppm, config, node, now);
    put_count(object, "bitrate", timing_bitrate_bps(&t));
    put_sample_point(object, "sample-point", &t);
    put_count(object, "tq_ps", timing_quanta_ps(&t, 1));
    put_count(object, "prop-seg", t.prop_seg);
    put_count(object, "phase-seg1", t.phase_seg1);
    put_count(object, "phase-seg2", t.phase_seg2);
    put_count(object, "sjw", t.sjw);
    put_count(object, "brp", t.brp);
    put_count(object, "clock", t.clock_hz);
    put(object, "ppm", json_integer(ppm));
    put_bool(object, "triple-sampling", now->triple_sampling);
    return object;
}

/* Puts the frames that a node knows, where nodes may differ in that. */
static void put_kind(json_t *object, const cfg *config, unsigned index)
{
    const cfg_node *node = &config->nodes[index];
    const bool tolerant = node->kind == CFG_KIND_FD_TOLERANT;
    const bool fd = cfg_knows_fd(config, node);
    if (!cfg_has_fd(config) && !tolerant && !cfg_is_old(node))
        return;
    put_text(object, "kind", cfg_kind_name(config, node));
    if (fd || tolerant)
        put_bool(object, "protocol-exception", !node->no_exception);
    if (fd)
        put_bool(object, "fd-non-iso", config->fd_non_iso);
}

/* Puts the bit timing of the data phase, with the names of `ip link`, where the node has one. */
static void put_data_timing(json_t *node, const cfg *config, const cw_bus *bus, unsigned index)
{
    data_timing t;
    if (!data_timing_now(&t, config, bus, index))
        return;
    json_t *object = json_object();
    put_count(object, "dbitrate", timing_bitrate_bps(&t.bit));
    put_sample_point(object, "dsample-point", &t.bit);
    put_count(object, "dtq_ps", timing_quanta_ps(&t.bit, 1));
    put_count(object, "dprop-seg", t.bit.prop_seg);
    put_count(object, "dphase-seg1", t.bit.phase_seg1);
    put_count(object, "dphase-seg2", t.bit.phase_seg2);
    put_count(object, "dsjw", t.bit.sjw);
    put_count(object, "dbrp", t.bit.brp);
    put_text(object, "tdc-mode", data_timing_tdc_name(t.tdc.mode));
    put_count(object, "tdcv", t.tdcv);
    put_count(object, "tdco", t.tdc.tdco);
    put(node, "data_timing", object);
}

/* Returns the counters between the node and its ECU. */
static json_t *interface_json(const port_stats *stats)
{
    json_t *object = json_object();
    output_put_counters(object, port_counters, CW_STAT_USUAL, stats);
    return object;
}

/* Returns the programs at a port. */
static json_t *clients_json(const port *p)
{
    port_client_info info;
    json_t *array = json_array();
    for (unsigned n = 0; port_client(p, n, &info); n++) {
        json_t *object = json_object();
        put_text(object, "name", info.name);
        put_count(object, "read", info.read);
        put_count(object, "written", info.written);
        put_count(object, "lost", info.lost);
        put_last(array, object);
    }
    return array;
}

/* Puts how programs share a port, with the words of the configuration. */
static void put_sharing(json_t *object, const cfg_node *node)
{
    put_text(object, "echo", node->clients.echo == CFG_ECHO_SENT ? "sent" : "at-once");
    put_bool(object, "beacon", node->clients.beacon);
}

/* Puts what is known of the tunnel at a port, if it is one. */
static void put_tunnel(json_t *node, const port *p)
{
    port_tunnel_info info;
    if (!p || !port_tunnel(p, &info))
        return;
    json_t *object = json_object();
    put_text(object, "state", info.state);
    output_put_counters(object, port_tunnel_counters, CW_STAT_USUAL, &info);
    put(node, "tunnel", object);
}

/* Describes a node: counters, settings and timing, and what its port and its link are like. */
static json_t *node_json(const cfg *config, const cw_bus *bus, unsigned node,
                         const report_node *own, const status_errors *errors)
{
    cw_node_stats stats = {.state = CW_STATE_ERROR_ACTIVE};
    cw_settings settings = {.which = 0};
    (void)cw_node_get_stats(bus, node, &stats);
    (void)cw_node_get_settings(bus, node, &settings);
    json_t *object = output_node_stats(&config->nodes[node], &stats);
    put_count(object, "rx_errors", errors->rx[node]);
    put_count(object, "tx_errors", errors->tx[node]);
    put_text(object, "controller", cfg_model_name(config->nodes[node].controller.model));
    put(object, "settings", settings_to_json(&settings));
    put(object, "timing", timing_json(config, node, &settings.timing));
    put_kind(object, config, node);
    put_data_timing(object, config, bus, node);
    put(object, "synchronisation", output_synchronisation(config, bus, node));
    output_put_more(object, bus, node);
    local_time_put(object, config, bus, node);
    if (config->nodes[node].guest > 0)
        put_count(object, "guest", config->nodes[node].guest);
    put_text(object, "link", link_names[own->link]);
    const char *when_full =
        config->nodes[node].port ? when_full_names[config->nodes[node].when_full] : NULL;
    put_text(object, "when-full", when_full);
    put_text(object, "when_full", when_full); /* deprecated, not in 0.3 */
    put_bool(object, "pushing_back", own->pushed_back);
    put(object, "interface",
        config->nodes[node].port ? interface_json(&own->interface) : json_null());
    if (own->port && (portname_is_shared(config->nodes[node].port) ||
                      cfg_is_usb(&config->nodes[node])))
        put(object, "clients", clients_json(own->port));
    if (own->port && portname_is_shared(config->nodes[node].port))
        put_sharing(object, &config->nodes[node]);
    put_tunnel(object, own->port);
    put_bool(object, "conserved", own->conserved);
    return object;
}

/* Adds to the counters what the engine knows: how far the bus is behind real time. */
static json_t *bus_json(const cfg *config, const cw_bus *bus, const report *beyond)
{
    json_t *object = output_bus_stats(config, bus);
    put_count(object, "lag_ns", beyond->lag_ns);
    put_count(object, "skips", beyond->skips);
    put_count(object, "skipped_ns", beyond->skipped_ns);
    return object;
}

/* Puts how far virtual time has come, if the bus has that. */
static void put_virtual(json_t *status, const cfg *config, const report_virtual *now)
{
    if (!now->on)
        return;
    json_t *object = json_object();
    put_text(object, "socket", config->virtual_time.socket);
    put_count(object, "programs", config->virtual_time.programs);
    put_count(object, "joined", now->programs);
    put_bool(object, "begun", now->begun);
    put_count(object, "now_ns", now->now_ns);
    put_text(object, "runs", now->runs);
    put_bool(object, "rests", now->rests);
    put(status, "virtual", object);
}

/* Returns the files that the configuration reads besides its own. */
static json_t *reads_json(const cfg *config)
{
    json_t *array = json_array();
    for (size_t i = 1; i < config->file_count; i++)
        put_last(array, text_to_json(config->files[i].name, strlen(config->files[i].name)));
    for (size_t i = 0; i < config->node_count; i++)
        for (size_t t = 0; t < config->nodes[i].traffic_count; t++) {
            const cfg_traffic *traffic = &config->nodes[i].traffic[t];
            if (traffic->kind == CFG_TRAFFIC_REPLAY)
                put_last(array, text_to_json(traffic->file, strlen(traffic->file)));
        }
    return array;
}

/* Puts the directory to which relative paths refer. */
static void put_directory(json_t *object)
{
    char *path = getcwd(NULL, 0);
    put_text(object, "directory", path);
    free(path);
}

json_t *status_json(const cfg *config, const cw_bus *bus, const report *beyond,
                    const status_errors *errors)
{
    json_t *object = json_object();
    json_t *nodes = json_array();
    put_text(object, "version", CANWIRE_VERSION);
    put_count(object, "pid", (uint64_t)getpid());
    put_text(object, "file", config->file);
    put_directory(object);
    put(object, "reads", reads_json(config));
    put_text(object, "control", config->control);
    put_virtual(object, config, &beyond->virtual_time);
    put(object, "bus", bus_json(config, bus, beyond));
    for (unsigned i = 0; i < config->node_count; i++)
        put_last(nodes, node_json(config, bus, i, &beyond->nodes[i], errors));
    put(object, "nodes", nodes);
    return object;
}

/* Describes a fault rule and what it has done. */
static json_t *fault_json(const live *rules, const cw_bus *bus, unsigned index)
{
    const cw_rule *rule = &live_config(rules)->rules[index];
    cw_rule_stats stats = {.matches = 0};
    (void)cw_rule_get_stats(bus, index, &stats);
    json_t *object = output_rule_stats(live_config(rules), bus, index);
    put_count(object, "misses", stats.misses);
    put_bool(object, "active", stats.active);
    put_bool(object, "over", stats.over);
    put_text(object, "action", cw_action_name(rule->action));
    put_bool(object, "manual", rule->manual);
    put_bool(object, "injected", live_is_injected(rules, index));
    return object;
}

json_t *status_faults(const live *rules, const cw_bus *bus)
{
    const cfg *config = live_config(rules);
    json_t *array = json_array();
    for (unsigned i = 0; i < config->rule_count; i++)
        if (config->rules[i].name)
            put_last(array, fault_json(rules, bus, i));
    return array;
}
