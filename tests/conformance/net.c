/* SPDX-License-Identifier: MIT
 *
 * net.c - couples controllers by wired-AND and compares what each of them reports.
 */
#include "net.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#define INTEGRATION_BITS 11
#define RUN_BITS 1500u /* enough for every case; all nodes must have come to rest */
#define LOG_MAX 900

typedef struct member {
    cw_mac mac;
    cw_fd_part part;
    const char *frames; /* not yet offered */
    char log[LOG_MAX];
} member;

typedef struct net {
    member member[NET_NODES_MAX];
    unsigned count;
    unsigned run, longest; /* dominant bits in a row */
} net;

static void offer_next(member *m);
static void play_bit(net *n, uint64_t inverted);
static void note(member *m, const cw_mac_report *report);
static uint64_t inverted_at(const net_case *c, unsigned bit, int flip_bit);
static void compare(const net *n, const net_case *c);

static void init_node(member *m, unsigned modes)
{
    const unsigned protocol = modes & NET_TOLERANT ? CW_FD_TOLERANT : CW_CLASSICAL;

    bench_init_node(&m->mac, &m->part, modes & ~(NET_CLASSICAL | NET_TOLERANT));
    if ((modes & (NET_CLASSICAL | NET_TOLERANT)) &&
        cw_mac_set_protocol(&m->mac, protocol, NULL) != CW_OK)
        bench_count("the protocol was refused");
}

void net_run(const net_case *c)
{
    static net n;
    wire w;
    const char *end;
    int flip_bit = -1;

    n = (net){0};
    if (!bench_in_pass(c->name))
        return;
    if (c->flip_frame && wire_parse_sent(&w, c->flip_frame, c->node[0].tec_before >= 128))
        flip_bit = wire_find(&w, c->flip_at, &end);
    for (; n.count < NET_NODES_MAX && c->node[n.count].frames; n.count++) {
        const net_node *node = &c->node[n.count];
        member *m = &n.member[n.count];
        init_node(m, node->modes);
        cw_mac_set_counters(&m->mac, node->tec_before, node->rec_before);
        m->frames = node->frames;
        offer_next(m);
    }
    for (unsigned i = 0; i < INTEGRATION_BITS; i++)
        play_bit(&n, 0);
    for (unsigned i = 0; i < RUN_BITS; i++)
        play_bit(&n, inverted_at(c, i, flip_bit));
    compare(&n, c);
}

static void offer_next(member *m)
{
    wire w;
    const char *end;

    m->frames += strspn(m->frames, " ");
    if (!*m->frames)
        return;
    end = wire_parse(&w, m->frames);
    if (!end || cw_mac_offer(&m->mac, &w.frame) != CW_OK)
        return; /* the log will lack it */
    m->frames = end;
}

static uint64_t inverted_at(const net_case *c, unsigned bit, int flip_bit)
{
    if (flip_bit < 0 || bit != (unsigned)flip_bit)
        return 0;
    return c->flip_node == NET_ALL ? UINT64_MAX : UINT64_C(1) << c->flip_node;
}

static void play_bit(net *n, uint64_t inverted)
{
    bool wired = true, level;
    cw_mac_report report;

    for (unsigned i = 0; i < n->count; i++)
        wired = cw_mac_drive(&n->member[i].mac) && wired;
    level = inverted == UINT64_MAX ? !wired : wired;
    n->run = level ? 0 : n->run + 1;
    if (n->run > n->longest)
        n->longest = n->run;
    for (unsigned i = 0; i < n->count; i++) {
        cw_mac_sample(&n->member[i].mac, wired != ((inverted >> i & 1) != 0), &report);
        note(&n->member[i], &report);
    }
}

/* ---- Logs ------------------------------------------------------------------------------------ */

static void add(member *m, const char *format, ...) __attribute__((format(printf, 2, 3)));

static void add(member *m, const char *format, ...)
{
    va_list arguments;
    size_t used = strlen(m->log);

    if (used > 0 && used + 1 < LOG_MAX)
        m->log[used++] = ' ';
    va_start(arguments, format);
    vsnprintf(m->log + used, LOG_MAX - used, format, arguments);
    va_end(arguments);
}

/* ESI is left out: it depends on the sender. */
static void add_frame(member *m, const cw_frame *frame)
{
    char data[2 * CW_FRAME_DATA_MAX + 1] = "";
    const bool brs = (frame->flags & CW_FRAME_BRS) != 0;
    const char *format = !(frame->flags & CW_FRAME_FD) ? "=" : brs ? "#1" : "#0";
    int digits = frame->flags & CW_FRAME_EXTENDED ? 8 : 3;

    if (frame->flags & CW_FRAME_REMOTE) {
        add(m, "rx:%0*X#R%X", digits, frame->id, frame->dlc);
        return;
    }
    for (unsigned i = 0; i < wire_data_bytes(frame); i++)
        snprintf(data + 2 * i, 3, "%02X", frame->data[i]);
    add(m, "rx:%0*X#%s%s", digits, frame->id, format, data);
}

/* Writes an expected log as add() would, with frames and the ACK slot in the format of the pass. */
static const char *written_out(const char *log)
{
    static member m;
    wire w;

    m.log[0] = 0;
    for (log += strspn(log, " "); *log; log += strspn(log, " ")) {
        const int length = (int)strcspn(log, " ");
        if (strncmp(log, "rx:", 3) == 0 && wire_parse(&w, log + 3))
            add_frame(&m, &w.frame);
        else if (strncmp(log, "ack:ackend:", 11) == 0)
            add(&m, "ack:ack%d:%.*s", wire_is_fd(), length - 11, log + 11);
        else
            add(&m, "%.*s", length, log);
        log += length;
    }
    return m.log;
}

static void note(member *m, const cw_mac_report *report)
{
    char place[NAME_MAX_LENGTH];
    const cw_error *e = &report->error;

    if (report->what & CW_REPORT_ARBITRATION_LOST)
        add(m, "lost%u", report->lost_bit);
    if (report->what & CW_REPORT_ERROR) {
        add(m, "%s:%s:%s:%s", cw_error_type_name(e->type), wire_place_text(place, e->place),
            e->role == CW_ROLE_TRANSMITTER ? "tx" : "rx", cw_flag_name(e->flag));
    }
    if (report->what & CW_REPORT_TOLERATED)
        add(m, "tol");
    if (report->what & CW_REPORT_OVERLOAD)
        add(m, "ovl");
    if (report->what & CW_REPORT_EXCEPTION)
        add(m, "exc");
    if (report->what & CW_REPORT_RX)
        add_frame(m, cw_mac_received(&m->mac));
    if (report->what & CW_REPORT_TX)
        add(m, "tx");
    if (report->what & CW_REPORT_DROPPED)
        add(m, "drop");
    if (report->what & (CW_REPORT_TX | CW_REPORT_DROPPED))
        offer_next(m);
}

static void compare(const net *n, const net_case *c)
{
    char why[2 * LOG_MAX + 200] = "";

    for (unsigned i = 0; i < n->count && !why[0]; i++) {
        const member *m = &n->member[i];
        const net_node *node = &c->node[i];
        const char *log = written_out(node->log);
        if (strcmp(m->log, log) != 0)
            snprintf(why, sizeof why, "%s, node %u: expected \"%s\", reported \"%s\"", c->name, i,
                     log, m->log);
        else if (cw_mac_tec(&m->mac) != node->tec || cw_mac_rec(&m->mac) != node->rec)
            snprintf(why, sizeof why, "%s, node %u: expected TEC %u REC %u, they are %u and %u",
                     c->name, i, node->tec, node->rec, cw_mac_tec(&m->mac), cw_mac_rec(&m->mac));
        else if (cw_mac_get_phase(&m->mac) != CW_MAC_IDLE)
            snprintf(why, sizeof why, "%s, node %u has not come to rest", c->name, i);
    }
    if (!why[0] && c->longest_dominant && n->longest != c->longest_dominant)
        snprintf(why, sizeof why, "%s: expected %u dominant bits in a row, seen %u", c->name,
                 c->longest_dominant, n->longest);
    bench_count(why[0] ? why : NULL);
}
