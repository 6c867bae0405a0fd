/* SPDX-License-Identifier: MIT
 *
 * tell.c - the results of buses in virtual time: statistics, expectations, losses.
 */
#include "embed/embed.h"

#include "base/text/jsonput.h"
#include "record/output.h"

#include <stdlib.h>
#include <string.h>

/* Returns the text of a value, which is released; NULL without memory. */
static char *tell_text_of(json_t *value, size_t flags)
{
    char *text = embed_text_failed() ? NULL : json_dumps(value, flags | JSON_PRESERVE_ORDER);
    json_decref(value);
    return text;
}

/* ---- Statistics ------------------------------------------------------------------------------ */

/* Sets the member that has the name of a counter. */
#define SET(form, type, name, unit, shown, also, column, sentence) SET_##also(name)
#define SET_NONE(name)
#define SET_LCM(name)
#define SET_SIM(name) out->name = s->name;
#define SET_LCM_SIM(name) SET_SIM(name)

/* Copies the counters; drops of all kinds are added up. */
static void set_sim_counters(canwire_sim_node *out, const cw_node_stats *s)
{
    CW_NODE_COUNTERS(SET)
    for (unsigned i = 0; i < CW_DROP_COUNT; i++) {
        out->dropped += s->dropped[i];
        out->rx_dropped += s->rx_dropped[i];
    }
}

/* Reads the counters of a node and its state at the time to which its bus has gone. */
int canwire_sim_get_node(const canwire_sim *sim, int node, canwire_sim_node *out)
{
    cw_node_stats s;
    cw_settings settings;
    const int bus = canwire_sim_bus_of_node(sim, node);
    if (bus < 0)
        return CANWIRE_SIM_INVALID;
    const embed_bus *b = &sim->buses[bus];
    const unsigned number = (unsigned)(node - b->first_node);
    (void)cw_node_get_stats(b->run.bus, number, &s);
    (void)cw_node_get_settings(b->run.bus, number, &settings);
    *out = (canwire_sim_node){.bit_errors = s.errors[CW_ERROR_BIT],
                              .stuff_errors = s.errors[CW_ERROR_STUFF],
                              .form_errors = s.errors[CW_ERROR_FORM],
                              .crc_errors = s.errors[CW_ERROR_CRC],
                              .ack_errors = s.errors[CW_ERROR_ACK],
                              .tec = s.tec,
                              .rec = s.rec,
                              .state = (uint8_t)s.state,
                              .attached = cw_node_attached(b->run.bus, number),
                              .fd = cfg_knows_fd(b->config, &b->config->nodes[number]),
                              .listen_only = (settings.modes & CW_MODE_LISTEN_ONLY) != 0};
    set_sim_counters(out, &s);
    return CANWIRE_SIM_OK;
}

/* Returns the statistics of all buses, and of the gateways between them, as JSON. */
static json_t *stats_of_all(const canwire_sim *sim)
{
    json_t *root = json_object();
    json_t *buses = json_array();
    for (size_t i = 0; i < sim->count; i++)
        put_last(buses, output_all_stats(sim->buses[i].config, sim->buses[i].run.bus));
    put(root, "buses", buses);
    if (sim->group.meeting.gateways)
        put(root, "gateways", gateways_stats(sim->group.meeting.gateways, GATEWAYS_ALL));
    return root;
}

char *canwire_sim_stats(canwire_sim *sim, int bus)
{
    embed_text_begin();
    if (bus == -1)
        return tell_text_of(stats_of_all(sim), JSON_INDENT(2));
    const embed_bus *b = embed_find_bus(sim, bus);
    return b ? tell_text_of(output_all_stats(b->config, b->run.bus), JSON_INDENT(2)) : NULL;
}

/* ---- Expectations ---------------------------------------------------------------------------- */

/* Judges from now on by some expectations. Returns false without memory. */
static bool add_judge(embed_bus *b, cfg_expects *own, cfg_expect *expects, size_t count)
{
    cw_bus_stats start;
    embed_judge *j = calloc(1, sizeof *j);
    if (!j)
        return false;
    j->view = *b->config;
    j->view.expects = expects;
    j->view.expect_count = count;
    cw_bus_get_stats(b->run.bus, &start);
    j->judge = expect_start(&j->view, &start);
    if (!j->judge) {
        free(j);
        return false;
    }
    j->own = own;
    embed_judge **end = &b->judges;
    while (*end)
        end = &(*end)->next;
    *end = j;
    return true;
}

bool embed_judge_add(embed_bus *b, cfg_expects *own)
{
    const bool good = add_judge(b, own, own->expects, own->count);
    embed_choose_events(b);
    return good;
}

bool embed_judge_start(embed_bus *b)
{
    const bool good = b->config->expect_count == 0 ||
                      add_judge(b, NULL, b->config->expects, b->config->expect_count);
    embed_choose_events(b);
    return good;
}

void embed_judge_end(embed_bus *b)
{
    while (b->judges) {
        embed_judge *j = b->judges;
        b->judges = j->next;
        expect_free(j->judge);
        cfg_free_expects(j->own);
        free(j);
    }
}

/* Appends the outcomes of one judge. */
static void put_outcomes(json_t *all, const embed_bus *b, const embed_judge *j)
{
    expect_report report = {.count = 0};
    if (!expect_conclude(j->judge, &report, b->run.bus))
        json_no_memory();
    for (size_t i = 0; i < report.count; i++) {
        const expect_outcome *o = &report.outcomes[i];
        json_t *object = json_object();
        put_text(object, "bus", b->config->bus_name);
        put_text(object, "name", o->name);
        put_text(object, "wanted", o->wanted);
        put_text(object, "got", o->got);
        put_bool(object, "met", o->met);
        put_last(all, object);
    }
    expect_report_free(&report);
}

char *canwire_sim_expectations(canwire_sim *sim)
{
    json_t *all = json_array();
    embed_text_begin();
    for (size_t i = 0; i < sim->count; i++)
        for (const embed_judge *j = sim->buses[i].judges; j; j = j->next)
            put_outcomes(all, &sim->buses[i], j);
    return tell_text_of(all, JSON_COMPACT);
}

/* ---- Losses ---------------------------------------------------------------------------------- */

typedef struct loss_list {
    json_t *all;
    const char *bus;
} loss_list;

/* Adds what has lost frames, or a rule that has lost its turn, to a list. */
static void put_loss(void *user, const loss_words *w)
{
    const loss_list *list = user;
    json_t *object = json_object();
    put_text(object, "bus", list->bus);
    put_text(object, w->is_rule ? "rule" : "node", w->name);
    put_text(object, "why", w->why);
    if (!w->is_rule)
        put_count(object, "frames", w->frames);
    if (w->ids[0])
        put_text(object, "ids", w->ids);
    if (w->help[0])
        put_text(object, "help", w->help);
    put_last(list->all, object);
}

char *canwire_sim_lost(canwire_sim *sim)
{
    json_t *all = json_array();
    embed_text_begin();
    for (size_t i = 0; i < sim->count; i++) {
        const embed_bus *b = &sim->buses[i];
        loss_list list = {.all = all, .bus = b->config->bus_name};
        losses_tell(&b->lost, b->run.bus, "", put_loss, &list);
    }
    return tell_text_of(all, JSON_COMPACT);
}
