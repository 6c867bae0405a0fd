/* SPDX-License-Identifier: MIT
 *
 * sim_trace.c - the bits of a run in virtual time, or a window of them, as VCD and as a picture.
 */
#include "cli/sim/sim_trace.h"

#include "base/text/plain.h"
#include "record/bitpart.h"

#include <assert.h>
#include <inttypes.h>

/* ---- The window ------------------------------------------------------------------------------ */

bool sim_trace_window(sim_trace *self, const time_option *from, const time_option *to,
                      const cfg *config, const char *program)
{
    self->from = from->text ? text_time_ticks(from->time, config->rate) : 0;
    self->to = to->text ? text_time_ticks(to->time, config->rate) : CW_NEVER;
    if (self->from < self->to)
        return true;
    if (to->text)
        plain_print(stderr, "%s: --to %s: expected a time after that of --from, %s\n", program,
                    to->text, from->text ? from->text : "0");
    else
        plain_print(stderr, "%s: --from %s: that is too late for any run\n", program, from->text);
    return false;
}

/* ---- Observing ------------------------------------------------------------------------------- */

/* Begins the outputs between two bits, at the start of the window. */
static void sim_trace_prepare(sim_trace *self, const cw_bus *bus)
{
    self->begun = true;
    if (self->vcd_out->stream)
        self->vcd = vcd_open(outfile_begin(self->vcd_out), self->run->config, bus);
    if (self->svg_out->stream)
        self->svg = svg_new(self->run->config, bus);
    self->no_memory =
        (self->vcd_out->stream && !self->vcd) || (self->svg_out->stream && !self->svg);
}

/* Returns the tick at which the window begins, the start of a bit. After bits at a data rate any
 * tick can be one, and only the present bit tells it. */
static uint64_t window_start(const sim_trace *self)
{
    const uint64_t bit = cw_rate_ticks(self->run->config->rate, 1);
    cw_bit_view now;
    if (cw_bus_get_bit(self->run->bus, &now) != CW_OK ||
        (now.start % bit == 0 && now.end % bit == 0))
        return cw_rate_bit_begin(self->run->config->rate, self->from);
    if (now.end > self->from)
        return now.start;
    return now.end + bit > self->from ? now.end : self->from;
}

/* Returns true for an event of the window. At its very start only rules that act from then on
 * belong to it; their events come before the bit that ends there. */
static bool is_inside(const sim_trace *self, const cw_event *event)
{
    const cfg *config = self->run->config;
    uint64_t start = window_start(self);
    bool acts = event->kind == CW_EVENT_FAULT && !bit_has_hit(&config->rules[event->rule]);
    return event->tick > start || (event->tick == start && acts);
}

/* Passes an event of the window on to the traces. */
static void take_event(void *user, const cw_event *event)
{
    sim_trace *self = user;
    if (self->left || self->no_memory || !is_inside(self, event))
        return;
    if (!self->begun)
        sim_trace_prepare(self, self->run->bus);
    if (self->vcd)
        vcd_event(self->vcd, event);
    if (self->svg && !svg_event(self->svg, event))
        self->no_memory = true;
}

/* Passes a bit of the window on. One before it shows the state in which the window begins. */
static void take_bit(void *user, const cw_bus *bus)
{
    sim_trace *self = user;
    cw_bit_view bit;
    cw_status status = cw_bus_get_bit(bus, &bit);
    assert(status == CW_OK);
    (void)status;
    const bool begun = self->begun;
    if (self->left)
        return;
    if (!begun)
        sim_trace_prepare(self, bus);
    if (bit.end <= self->from || self->no_memory) { /* it was needed to see the state before the
                                                       window */
        if (self->svg && begun)
            svg_skip(self->svg, &bit);
        return;
    }
    if (self->vcd)
        vcd_bit(self->vcd, &bit);
    if (self->svg && !svg_bit(self->svg, &bit))
        self->no_memory = true;
}

/* Returns false after a message that says how to get a smaller picture. */
static bool fits_picture(uint64_t bits, const char *program)
{
    if (bits > SVG_BITS_MAX)
        plain_print(stderr,
                    "%s: --svg: a picture has at most %d bits, these are %" PRIu64
                    ": choose others by --from and --to\n",
                    program, SVG_BITS_MAX, bits);
    return bits <= SVG_BITS_MAX;
}

/* Returns the bits of the window that the run is sure to have, as far as its end is known.
 * Otherwise it returns all bits that overlap with a window that has an end. */
static uint64_t known_bits(const sim_trace *self, uint64_t end, cw_rate rate)
{
    uint64_t from = cw_rate_bits(rate, self->from);
    /* whole ones, from the start on */
    uint64_t bits = end != CW_NEVER ? cw_rate_bits(rate, end) : 0;
    if (self->to <= end && self->to != CW_NEVER)
        bits = cw_rate_bits_begun(rate, self->to);
    return bits > from ? bits - from : 0;
}

/* Checks the facts known before the run, so that no output is changed in vain. */
static bool is_possible(const sim_trace *self, uint64_t end, cw_rate rate,
                        const char *program)
{
    if (end != CW_NEVER && self->from > end && cw_rate_bits(rate, self->from - end) > 0) {
        plain_print(stderr, "%s: --from: the run ends before\n", program);
        return false;
    }
    return !self->svg_out->stream || fits_picture(known_bits(self, end, rate), program);
}

bool sim_trace_start(sim_trace *self, sim_run *run, uint64_t end, const char *program)
{
    const uint64_t bit = cw_rate_ticks(run->config->rate, 1);
    if (!self->vcd_out->stream && !self->svg_out->stream)
        return true;
    if (!is_possible(self, end, run->config->rate, program))
        return false;
    const sim_sink sink = {
        .user = self,
        .event = take_event,
        .bit = take_bit,
        .bits_from = self->from >= bit ? self->from - bit : 0,
        .bits_to = self->to == CW_NEVER ? 0 : self->to,
        .changes = !self->svg_out->stream,
    };
    self->run = run;
    sim_add_sink(run, &sink);
    return true;
}

void sim_trace_begin(sim_trace *self)
{
    if (self->run && cw_rate_bits(self->run->config->rate, self->from) == 0)
        sim_trace_prepare(self, self->run->bus);
}

/* Writes the picture, unless it would have too many bits. */
static bool draw(const sim_trace *self, const char *program)
{
    if (!fits_picture(svg_count(self->svg), program))
        return false;
    bool good = svg_write(outfile_begin(self->svg_out), self->svg, self->to);
    if (!good)
        plain_print(stderr, "%s: out of memory\n", program);
    return good;
}

bool sim_trace_finish(sim_trace *self, const char *program)
{
    if (!self->run || self->left)
        return !self->run || self->good;
    vcd_close(self->vcd);
    self->vcd = NULL;
    bool empty = !self->begun || (self->svg && svg_count(self->svg) == 0);
    if (self->no_memory)
        plain_print(stderr, "%s: out of memory\n", program);
    else if (empty)
        plain_print(stderr, "%s: --from: the run ends before\n", program);
    return !self->no_memory && !empty && (!self->svg || draw(self, program));
}

void sim_trace_leave(sim_trace *self, const char *program)
{
    char time[TIME_TEXT_MAX];
    if (!self->run || self->left || !self->begun)
        return;
    text_print_seconds(time, cw_bus_now(self->run->bus));
    if (cw_bus_now(self->run->bus) < self->to)
        plain_print(stderr,
                    "%s: the bus goes over to other nodes at %s s: --vcd and --svg end there\n",
                    program, time);
    self->good = sim_trace_finish(self, program);
    self->left = true;
}

void sim_trace_close(sim_trace *self)
{
    vcd_close(self->vcd);
    svg_free(self->svg);
    self->vcd = NULL;
    self->svg = NULL;
}
