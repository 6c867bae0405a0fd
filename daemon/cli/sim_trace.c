/* SPDX-License-Identifier: MIT
 *
 * sim_trace.c - the bits of a run in virtual time, or a window of them, as VCD and as a picture.
 */
#include "sim_trace.h"

#include "bitpart.h"

#include <assert.h>
#include <inttypes.h>

/* ---- The window ------------------------------------------------------------------------------ */

static bool parse_tick(uint64_t *tick, const char *option, const char *text, const cfg *config,
                       const char *program)
{
    cfg_time time;
    if (!text)
        return true;
    const char *wrong = text_parse_time(&time, text);
    if (wrong)
        fprintf(stderr, "%s: %s %s: %s\n", program, option, text, wrong);
    else
        *tick = text_time_ticks(time, config->bit_ticks);
    return !wrong;
}

bool sim_trace_window(sim_trace *self, const char *from, const char *to, const cfg *config,
                      const char *program)
{
    self->from = 0;
    self->to = CW_NEVER;
    if (!parse_tick(&self->from, "--from", from, config, program) ||
        !parse_tick(&self->to, "--to", to, config, program))
        return false;
    if (self->from < self->to)
        return true;
    fprintf(stderr, "%s: --from %s --to %s: the window ends before it begins\n", program,
            from ? from : "0", to ? to : "");
    return false;
}

/* ---- Looking on ------------------------------------------------------------------------------ */

/* Between two bits, at the start of the window. */
static void begin(sim_trace *self, const cw_bus *bus)
{
    self->begun = true;
    if (self->vcd_out)
        self->vcd = vcd_open(self->vcd_out, self->run->config, bus);
    if (self->svg_out)
        self->svg = svg_new(self->run->config, bus);
    self->no_memory = (self->vcd_out && !self->vcd) || (self->svg_out && !self->svg);
}

/* At the very start of the window only what acts from then on; that comes before the bit has been
 * passed on which ends there. */
static bool is_inside(const sim_trace *self, const cw_event *event)
{
    const cfg *config = self->run->config;
    uint64_t start = self->from - self->from % config->bit_ticks;
    bool acts = event->kind == CW_EVENT_FAULT && !bit_has_hit(&config->rules[event->rule]);
    return event->tick > start || (event->tick == start && acts);
}

static void take_event(void *user, const cw_event *event)
{
    sim_trace *self = user;
    if (self->left || self->no_memory || !is_inside(self, event))
        return;
    if (!self->begun)
        begin(self, self->run->bus);
    if (self->vcd)
        vcd_event(self->vcd, event);
    if (self->svg && !svg_event(self->svg, event))
        self->no_memory = true;
}

static void take_bit(void *user, const cw_bus *bus)
{
    sim_trace *self = user;
    cw_bit_view bit;
    cw_status status = cw_bus_get_bit(bus, &bit);
    assert(status == CW_OK);
    (void)status;
    if (self->left)
        return;
    if (!self->begun)
        begin(self, bus);
    if (bit.end <= self->from || self->no_memory) /* it was to see what the window begins with */
        return;
    if (self->vcd)
        vcd_bit(self->vcd, &bit);
    if (self->svg && !svg_bit(self->svg, &bit))
        self->no_memory = true;
}

static bool fits_picture(uint64_t bits, const char *program)
{
    if (bits > SVG_BITS_MAX)
        fprintf(stderr,
                "%s: --svg: a picture has at most %d bits, these are %" PRIu64
                ": choose others by --from and --to\n",
                program, SVG_BITS_MAX, bits);
    return bits <= SVG_BITS_MAX;
}

/* Whole bits that overlap with the window. */
static uint64_t window_bits(const sim_trace *self, uint32_t bit_ticks)
{
    return (self->to - 1) / bit_ticks - self->from / bit_ticks + 1;
}

bool sim_trace_start(sim_trace *self, sim_run *run, const char *program)
{
    const uint32_t bit_ticks = run->config->bit_ticks;
    if (!self->vcd_out && !self->svg_out)
        return true;
    if (self->svg_out && self->to != CW_NEVER &&
        !fits_picture(window_bits(self, bit_ticks), program))
        return false;
    const sim_sink sink = {
        .user = self,
        .event = take_event,
        .bit = take_bit,
        .bits_from = self->from >= bit_ticks ? self->from - bit_ticks : 0,
        .bits_to = self->to == CW_NEVER ? 0 : self->to,
    };
    self->run = run;
    sim_add_sink(run, &sink);
    if (self->from < bit_ticks)
        begin(self, run->bus);
    return true;
}

static bool draw(const sim_trace *self, const char *program)
{
    if (!fits_picture(svg_count(self->svg), program))
        return false;
    bool good = svg_write(self->svg_out, self->svg);
    if (!good)
        fprintf(stderr, "%s: out of memory\n", program);
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
        fprintf(stderr, "%s: out of memory\n", program);
    else if (empty)
        fprintf(stderr, "%s: --from: the run ends before\n", program);
    return !self->no_memory && !empty && (!self->svg || draw(self, program));
}

void sim_trace_leave(sim_trace *self, const char *program)
{
    char time[TIME_TEXT_MAX];
    if (!self->run || self->left || !self->begun)
        return;
    text_print_seconds(time, cw_bus_now(self->run->bus));
    if (cw_bus_now(self->run->bus) < self->to)
        fprintf(stderr,
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
