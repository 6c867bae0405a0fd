/* SPDX-License-Identifier: MIT
 *
 * svg.c - a picture of some bits of a bus, for reports: levels, fields, errors, faults.
 *
 * Colours and sizes are attributes, since word processors do not support style sheets. The classes
 * of elements are for readers of the file.
 */
#include "cli/svg/svg.h"

#include "base/text/chars.h"
#include "base/text/decimal.h"
#include "base/text/xmltext.h"
#include "cli/svg/svg_inside.h"
#include "cli/svg/svg_layout.h"
#include "cli/svg/svg_parts.h"
#include "record/data_timing.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#define BITS_FIRST 256   /* initial capacity */
#define LETTERS_TURNED 3 /* of a label on its side */
#define CAPTION_MAX 160
#define WIRE_NAMES_MAX 128 /* bytes with the final 0; more than any row has room for */
#define ELLIPSIS "\xE2\x80\xA6"

struct svg {
    const cfg *config;
    cw_bit_view *bits;
    size_t count; /* taken; the first SVG_BITS_MAX of them are kept */
    size_t capacity;
    note_list notes;
    inside_list *inside; /* NULL: all bits are common to all nodes */
    uint64_t sampled;      /* by the nodes last, where bits are not common to all */
    uint32_t dbitrate_bps; /* of the first node that has a data rate; 0: none has */
    uint64_t number;       /* bits of the bus before the picture, where there is a data rate */
    struct {
        cw_state state;
        uint16_t tec;
        uint16_t rec;
    } before[CW_NODES_MAX]; /* at the start */
};

/* The state of drawing a picture. */
typedef struct pen {
    FILE *out;
    const svg *svg;
    svg_layout layout;
    const svg_row *row;
    int y; /* top of the present lane */
} pen;

static size_t kept(const svg *self)
{
    return self->count < SVG_BITS_MAX ? self->count : SVG_BITS_MAX;
}

/* ---- Taking bits ----------------------------------------------------------------------------- */

/* Notes the data rate, and the number of the first bit, when the picture begins. */
static void note_rates(svg *self, const cw_bus *bus)
{
    data_timing t;
    cw_bus_stats stats;
    for (unsigned i = 0; i < self->config->node_count && self->dbitrate_bps == 0; i++)
        if (data_timing_now(&t, self->config, bus, i))
            self->dbitrate_bps = timing_bitrate_bps(&t.bit);
    cw_bus_get_stats(bus, &stats);
    self->number = stats.bits;
}

svg *svg_new(const cfg *config, const cw_bus *bus)
{
    svg *self = calloc(1, sizeof *self);
    if (!self)
        return NULL;
    if (cfg_has_clocks(config) && !cw_bus_is_on_grid(bus)) {
        self->inside = calloc(1, sizeof *self->inside);
        if (!self->inside) {
            free(self);
            return NULL;
        }
    }
    self->config = config;
    note_rates(self, bus);
    notes_init(&self->notes, config, bus);
    for (unsigned i = 0; i < config->node_count; i++) {
        self->before[i].state = self->notes.before[i].state;
        self->before[i].tec = self->notes.before[i].tec;
        self->before[i].rec = self->notes.before[i].rec;
    }
    return self;
}

void svg_free(svg *self)
{
    if (!self)
        return;
    notes_free(&self->notes);
    inside_free(self->inside);
    free(self->bits);
    free(self);
}

size_t svg_count(const svg *self)
{
    return self->count;
}

bool svg_event(svg *self, const cw_event *event)
{
    return self->count >= SVG_BITS_MAX || notes_event(&self->notes, event);
}

/* Makes room for one more bit. False without memory: the bits so far stay. */
static bool svg_make_room(svg *self)
{
    if (self->count < self->capacity)
        return true;
    size_t capacity = self->capacity ? 2 * self->capacity : BITS_FIRST;
    cw_bit_view *bits = realloc(self->bits, capacity * sizeof *bits);
    if (!bits)
        return false;
    self->bits = bits;
    self->capacity = capacity;
    return true;
}

void svg_skip(svg *self, const cw_bit_view *bit)
{
    self->number++;
    self->notes.end = bit->end;
}

/* A node that samples at moments of its own keeps its level from one to the next. */
static void keep_samples(svg *self, cw_bit_view *bit)
{
    uint64_t now = bit->sampled;
    if (bit->mark_count > 0 && !bit_rests(bit)) {
        now = bit->sampled = self->count > 0 ? self->sampled : bit->sampled;
        for (unsigned i = 0; i < bit->mark_count; i++) {
            const cw_mark *m = &bit->marks[i];
            const uint64_t node = UINT64_C(1) << m->node;
            if (m->kind == CW_MARK_SAMPLE)
                now = m->level ? now | node : now & ~node;
        }
    }
    self->sampled = now;
    bit->marks = NULL; /* the bus keeps them only for now */
}

bool svg_bit(svg *self, const cw_bit_view *bit)
{
    if (self->count >= SVG_BITS_MAX) {
        self->count++;
        return true;
    }
    if (!svg_make_room(self))
        return false;
    if (self->inside && !inside_bit(self->inside, bit, self->count))
        return false;
    self->bits[self->count] = *bit;
    keep_samples(self, &self->bits[self->count++]);
    return notes_bit(&self->notes, bit);
}

/* ---- Elements -------------------------------------------------------------------------------- */

/* Writes a text. attributes: all but the place, beginning with a blank. */
static void put_text(const pen *p, int x, int y, const char *attributes, const char *text)
{
    fprintf(p->out, "<text x=\"%d\" y=\"%d\"%s>", x, y, attributes);
    xml_text(p->out, text);
    fputs("</text>\n", p->out);
}

static void put_rect(const pen *p, int x, int y, int width, int height, const char *attributes)
{
    fprintf(p->out, "<rect x=\"%d\" y=\"%d\" width=\"%d\" height=\"%d\"%s/>\n", x, y, width, height,
            attributes);
}

static void put_line(const pen *p, int x1, int y1, int x2, int y2, const char *attributes)
{
    fprintf(p->out, "<path d=\"M%d %dL%d %d\"%s/>\n", x1, y1, x2, y2, attributes);
}

static int bit_x(const pen *p, size_t bit)
{
    return svg_layout_x(&p->layout, p->row, bit);
}

static int bit_width(const pen *p, size_t bit)
{
    return svg_layout_width(&p->layout, p->row, bit);
}

/* Prints microseconds, with a fraction unless that is 0. */
static void print_us(char out[SVG_LABEL_MAX], uint64_t tick)
{
    uint64_t ns = text_ticks_ns(tick);
    snprintf(out, SVG_LABEL_MAX, "%s", decimal(ns, 3).text);
}

/* ---- Axis ------------------------------------------------------------------------------------ */

/* Writes a number at the start of a bit, unless it would exceed the row. */
static void put_number(const pen *p, size_t bit, int y, const char *text)
{
    int x = bit_x(p, bit);
    if (x + (int)strlen(text) * SVG_LETTER <= bit_x(p, p->row->end))
        put_text(p, x + 2, y, "", text);
}

/* Returns the number of a bit since the start of the bus. Without a data rate, time tells it. */
static uint64_t bit_number(const pen *p, size_t bit)
{
    const uint64_t before = p->svg->dbitrate_bps
                                ? p->svg->number
                                : cw_rate_bits(p->svg->config->rate, p->svg->bits[0].start);
    return before + bit;
}

/* Draws the grid of bits. Each fifth or tenth has its number and its time. */
static void draw_ticks(const pen *p, int y)
{
    const svg_row *row = p->row;
    const unsigned every = p->layout.bit >= 2 * SVG_BIT_MIN ? 5 : 10;
    for (size_t b = row->first; b <= row->end; b++) {
        uint64_t tick = svg_layout_start(&p->layout, b);
        uint64_t number = bit_number(p, b);
        bool numbered = number % every == 0;
        char text[SVG_LABEL_MAX];
        put_line(p, bit_x(p, b), y - (numbered ? 22 : 3), bit_x(p, b), y, " stroke=\"#9a9a9a\"");
        if (!numbered)
            continue;
        put_line(p, bit_x(p, b), y, bit_x(p, b), row->y + row->height - SVG_GAP,
                 " stroke=\"#e4e4e4\"");
        print_us(text, tick);
        put_number(p, b, y - 15, text);
        snprintf(text, sizeof text, "%" PRIu64, number);
        put_number(p, b, y - 5, text);
    }
}

static bool is_fast(const pen *p, size_t bit)
{
    return p->svg->bits[bit].fast != 0;
}

/* Draws a bar above bits that nodes begin at the data rate. */
static void draw_rates(const pen *p, int y)
{
    size_t first = p->row->first;
    for (size_t b = first; b <= p->row->end; b++) {
        if (b < p->row->end && is_fast(p, b) == is_fast(p, first))
            continue;
        if (is_fast(p, first))
            put_rect(p, bit_x(p, first), y, bit_x(p, b) - bit_x(p, first), 4,
                     " class=\"data-rate\" fill=\"" DATA_RATE "\"");
        first = b;
    }
}

/* Draws bus time and the number of the bit since the start of the bus. */
static void draw_axis(pen *p)
{
    const int y = p->y + SVG_AXIS - 6;
    fputs("<g class=\"axis\" font-size=\"9\" fill=\"" FAINT "\">\n", p->out);
    draw_ticks(p, y);
    draw_rates(p, y);
    put_line(p, bit_x(p, p->row->first), y, bit_x(p, p->row->end), y, " stroke=\"#9a9a9a\"");
    put_text(p, SVG_MARGIN, y - 15, "", "time in \xC2\xB5s");
    put_text(p, SVG_MARGIN, y - 5, "", "bit");
    fputs("</g>\n", p->out);
    p->y += SVG_AXIS;
}

/* ---- Levels ---------------------------------------------------------------------------------- */

/* The level of one lane in one bit. */
typedef enum level { LEVEL_NONE = 0, LEVEL_DOMINANT, LEVEL_RECESSIVE } level;

typedef level level_of(const cw_bit_view *bit, unsigned which);

static level as_level(uint64_t levels, unsigned node)
{
    return levels >> node & 1u ? LEVEL_RECESSIVE : LEVEL_DOMINANT;
}

static bool svg_is_away(const cw_bit_node *n)
{
    return n->phase == CW_MAC_OFF || n->phase == CW_MAC_BUS_OFF || n->phase == CW_MAC_ASLEEP;
}

static level driven_level(const cw_bit_view *bit, unsigned node)
{
    return svg_is_away(&bit->nodes[node]) ? LEVEL_NONE : as_level(bit->driven, node);
}

static level sampled_level(const cw_bit_view *bit, unsigned node)
{
    return svg_is_away(&bit->nodes[node]) ? LEVEL_NONE : as_level(bit->sampled, node);
}

/* Returns the nodes of a wire. */
static uint64_t wire_nodes(const cw_bit_view *bit, unsigned wire)
{
    uint64_t nodes = 0;
    for (unsigned i = 0; i < bit->node_count; i++)
        if (bit->nodes[i].wire == wire)
            nodes |= UINT64_C(1) << i;
    return nodes;
}

/* Returns the level on a wire. Parts of a broken line have levels of their own. */
static level wire_level(const cw_bit_view *bit, unsigned wire)
{
    uint64_t nodes = wire_nodes(bit, wire);
    if (nodes == 0)
        return LEVEL_NONE;
    return (bit->wire & nodes) == nodes ? LEVEL_RECESSIVE : LEVEL_DOMINANT;
}

/* A lane of levels: of a wire, or of a node. */
typedef struct level_lane {
    level_of *at_begin; /* of a bit */
    inside_kind inside; /* the kind of moments that change it in the bit */
    unsigned which;
} level_lane;

static bool is_in_lane(const pen *p, const level_lane *l, const inside_moment *m)
{
    const unsigned wire = p->svg->bits[m->bit].nodes[m->node].wire;
    return m->kind == l->inside && (l->inside == INSIDE_WIRE ? wire : m->node) == l->which;
}

/* The line of a lane as it is drawn. */
typedef struct wave {
    int top;
    level now;
} wave;

/* Draws the line up to a place, in hundredths of a pixel, and changes its level there. */
static void change_wave(const pen *p, wave *w, int x, level to)
{
    char place[32];
    const int y = to == LEVEL_RECESSIVE ? w->top + 2 : w->top + SVG_WAVE - 2;
    if (to == w->now)
        return;
    snprintf(place, sizeof place, x % 100 ? "%d.%02d" : "%d", x / 100, x % 100);
    if (w->now != LEVEL_NONE)
        fprintf(p->out, "H%s", place);
    if (to != LEVEL_NONE && w->now == LEVEL_NONE)
        fprintf(p->out, "M%s %d", place, y);
    else if (to != LEVEL_NONE)
        fprintf(p->out, "V%d", y);
    w->now = to;
}

/* Draws the changes of a level inside a bit. */
static void draw_wave_inside(const pen *p, wave *w, const level_lane *l, size_t bit)
{
    const inside_list *in = p->svg->inside;
    const size_t end = in && w->now != LEVEL_NONE ? inside_before(in, bit + 1) : 0;
    for (size_t i = end ? inside_before(in, bit) : 0; i < end; i++) {
        const inside_moment *m = &in->list[i];
        const int x = bit_x(p, bit) * 100 +
                      (int)(m->place * (unsigned)bit_width(p, bit) * 100 / SVG_PLACES);
        if (is_in_lane(p, l, m))
            change_wave(p, w, x, m->level ? LEVEL_RECESSIVE : LEVEL_DOMINANT);
    }
}

/* Draws a line through all bits of the row, recessive high; top is that of the lane. */
static void draw_wave(const pen *p, int top, const level_lane *l, const char *attributes)
{
    wave w = {.top = top, .now = LEVEL_NONE};
    fprintf(p->out, "<path%s fill=\"none\" d=\"", attributes);
    for (size_t b = p->row->first; b < p->row->end; b++) {
        change_wave(p, &w, bit_x(p, b) * 100, l->at_begin(&p->svg->bits[b], l->which));
        draw_wave_inside(p, &w, l, b);
    }
    change_wave(p, &w, bit_x(p, p->row->end) * 100, LEVEL_NONE);
    fputs("\"/>\n", p->out);
}

/* Returns the level in the middle of a bit. */
static level level_in_middle(const pen *p, const level_lane *l, size_t bit)
{
    const inside_list *in = p->svg->inside;
    const size_t end = in ? inside_before(in, bit + 1) : 0;
    level now = l->at_begin(&p->svg->bits[bit], l->which);
    for (size_t i = in ? inside_before(in, bit) : 0; i < end; i++)
        if (now != LEVEL_NONE && in->list[i].place <= SVG_PLACES / 2 &&
            is_in_lane(p, l, &in->list[i]))
            now = in->list[i].level ? LEVEL_RECESSIVE : LEVEL_DOMINANT;
    return now;
}

/* Marks bits of a lane in which faults have changed the level. */
static void draw_faults(const pen *p, int top, bool (*is_faulty)(const cw_bit_view *, unsigned),
                        unsigned which)
{
    for (size_t b = p->row->first; b < p->row->end; b++)
        if (is_faulty(&p->svg->bits[b], which))
            put_rect(p, bit_x(p, b), top - 1, bit_width(p, b), SVG_WAVE + 2,
                     " class=\"fault\" fill=\"" FAULT "\" fill-opacity=\".25\" stroke=\"" FAULT
                     "\"");
}

static bool wire_is_faulty(const cw_bit_view *bit, unsigned wire)
{
    return bit->wire_faults & wire_nodes(bit, wire);
}

static bool node_is_faulty(const cw_bit_view *bit, unsigned node)
{
    return (bit->tx_faults | bit->rx_faults) >> node & 1u;
}

/* ---- Wires ----------------------------------------------------------------------------------- */

/* Writes the level of each bit as a digit below the line. */
static void draw_digits(const pen *p, const level_lane *l)
{
    put_rect(p, bit_x(p, p->row->first), p->y + SVG_WAVE + 1,
             bit_x(p, p->row->end) - bit_x(p, p->row->first), 8, " fill=\"#ffffff\"");
    fputs("<g font-size=\"8\" fill=\"" FAINT "\" text-anchor=\"middle\">\n", p->out);
    for (size_t b = p->row->first; b < p->row->end; b++) {
        const level now = level_in_middle(p, l, b);
        if (now != LEVEL_NONE)
            put_text(p, bit_x(p, b) + bit_width(p, b) / 2, p->y + SVG_WAVE + 8, "",
                     now == LEVEL_RECESSIVE ? "1" : "0");
    }
    fputs("</g>\n", p->out);
}

/* Prints names of the nodes on a wire, as far as there is room. */
static void print_wire_nodes(char out[WIRE_NAMES_MAX], const pen *p, unsigned wire)
{
    const cw_bit_view *bit = &p->svg->bits[p->row->first];
    for (size_t b = p->row->first; b < p->row->end && bit->wire_count < p->row->wires; b++)
        bit = &p->svg->bits[b];
    uint64_t nodes = wire_nodes(bit, wire);
    size_t used = 0;
    out[0] = '\0';
    const size_t room = (size_t)svg_layout_letters(&p->layout, SVG_NAME_SIZE_SMALL);
    for (unsigned i = 0; i < bit->node_count; i++)
        if (nodes >> i & 1u)
            used = chars_print(out, WIRE_NAMES_MAX, used, "%s%s", used ? ", " : "",
                               p->svg->config->nodes[i].name);
    if (strlen(out) > room)
        memcpy(out + room - 1, ELLIPSIS, sizeof ELLIPSIS);
}

/* Draws the level on a wire. If there are several, each says which nodes it has. */
static void draw_wire(pen *p, unsigned wire)
{
    fputs("<g class=\"wire\">\n", p->out);
    put_text(p, SVG_MARGIN, p->y + 12, " font-size=\"11\" font-weight=\"bold\"", "wire");
    if (p->row->wires > 1) {
        char names[WIRE_NAMES_MAX];
        print_wire_nodes(names, p, wire);
        put_text(p, SVG_MARGIN, p->y + 24, SVG_NAME_FONT " font-size=\"9\" fill=\"" FAINT "\"",
                 names);
    }
    draw_faults(p, p->y, wire_is_faulty, wire);
    const level_lane l = {wire_level, INSIDE_WIRE, wire};
    draw_wave(p, p->y, &l, " stroke=\"" INK "\" stroke-width=\"1.6\"");
    draw_digits(p, &l);
    fputs("</g>\n", p->out);
    p->y += svg_layout_wire();
}

/* ---- Fields ---------------------------------------------------------------------------------- */

/* Finds the longest run of a part without stuff bits. */
static void find_space(const svg *s, unsigned node, size_t *first, size_t *end)
{
    size_t start = *first;
    size_t last = *end;
    *end = start;
    for (size_t b = start; b <= last; b++) {
        if (b < last && !s->bits[b].nodes[node].place.stuff)
            continue;
        if (b - start > *end - *first) {
            *first = start;
            *end = b;
        }
        start = b + 1;
    }
}

/* Draws a label, turned by 90 degrees where it has no room otherwise, as in single bits. It omits
 * the value when the node becomes a receiver in the middle of the part. */
static void draw_label(const pen *p, unsigned node, size_t first, size_t end)
{
    const svg *s = p->svg;
    bool whole = end == p->row->end || !svg_same_part(s->bits, node, end);
    bit_part part = bit_part_of(&s->bits[first], node);
    char label[SVG_LABEL_MAX];
    find_space(s, node, &first, &end);
    int width = bit_x(p, end) - bit_x(p, first);
    int middle = bit_x(p, first) + width / 2;
    svg_label(label, s->bits, kept(s), node, first, (width - 2) / SVG_LETTER, whole);
    bool turned = label[0] == '\0' && width > 0;
    if (turned)
        svg_label(label, s->bits, kept(s), node, first, LETTERS_TURNED, false);
    if (label[0] == '\0')
        return;
    fprintf(p->out, "<text class=\"label\" text-anchor=\"middle\" fill=\"%s\"",
            svg_part_style(&part)->ink);
    if (turned)
        fprintf(p->out, " font-size=\"8\" transform=\"translate(%d %d)rotate(-90)\">", middle + 3,
                p->y + SVG_BAND / 2);
    else
        fprintf(p->out, " x=\"%d\" y=\"%d\">", middle, p->y + SVG_BAND - 5);
    xml_text(p->out, label);
    fputs("</text>\n", p->out);
}

/* Marks the stuff bits of a part. */
static void draw_stuff(const pen *p, unsigned node, size_t first, size_t end)
{
    for (size_t b = first; b < end; b++) {
        if (!p->svg->bits[b].nodes[node].place.stuff)
            continue;
        put_rect(p, bit_x(p, b), p->y, bit_width(p, b), SVG_BAND,
                 " class=\"stuff\" fill=\"#3d3d3d\" stroke=\"#ffffff\"");
        put_text(p, bit_x(p, b) + bit_width(p, b) / 2, p->y + SVG_BAND - 6,
                 " font-size=\"9\" fill=\"#ffffff\" text-anchor=\"middle\"", "s");
    }
}

/* Returns a colour, or its mix with white: a transparent one would show the lines below. */
static unsigned long colour(const char *fill, bool half)
{
    unsigned long rgb = strtoul(fill + 1, NULL, 16);
    return half ? (rgb >> 1 & 0x7F7F7F) + 0x808080 : rgb;
}

/* Draws the part of a node in some bits of a row. The fields of a transmitter have a stronger
 * colour than those of a receiver. */
static void draw_part(const pen *p, unsigned node, size_t first, size_t end)
{
    const cw_bit_view *bit = &p->svg->bits[first];
    bit_part part = bit_part_of(bit, node);
    const svg_style *look = svg_part_style(&part);
    int x = bit_x(p, first);
    int width = bit_x(p, end) - x;
    bool follows = part.phase == CW_MAC_FRAME && bit->nodes[node].role == CW_ROLE_RECEIVER;
    char name[BIT_PART_TEXT_MAX];
    bit_part_print(name, &part);
    fprintf(p->out,
            "<rect class=\"field %s\" x=\"%d\" y=\"%d\" width=\"%d\" height=\"%d\" "
            "fill=\"#%06lx\" stroke=\"#ffffff\"/>\n",
            name, x, p->y, width, SVG_BAND, colour(look->fill, follows));
    draw_stuff(p, node, first, end);
    draw_label(p, node, first, end);
}

/* Draws what a node takes the bits for: stretches of one field and one role. */
static void draw_parts(const pen *p, unsigned node)
{
    size_t first = p->row->first;
    for (size_t b = first + 1; b <= p->row->end; b++) {
        const cw_bit_view *bits = p->svg->bits;
        if (b < p->row->end && svg_same_part(bits, node, b) &&
            bits[b - 1].nodes[node].role == bits[b].nodes[node].role)
            continue;
        draw_part(p, node, first, b);
        first = b;
    }
}

/* ---- Notes ----------------------------------------------------------------------------------- */

static const char *const note_colours[NOTE_KIND_COUNT] = {
    [NOTE_COUNTERS] = FAINT, [NOTE_FRAME] = "#1b7a34",    [NOTE_LOST] = DRIVEN,
    [NOTE_STATE] = STATE,    [NOTE_OVERLOAD] = "#b3620c", [NOTE_ERROR] = ERROR_RED,
    [NOTE_FAULT] = FAULT,
};

static bool in_lane(const pen *p, const placed_note *n, unsigned lane)
{
    size_t bit = note_bit(n->note);
    return n->note->node == lane && bit >= p->row->first && bit < p->row->end;
}

/* Draws a text with white behind it, which keeps lines of other notes out of it. */
static void draw_note_text(const pen *p, const placed_note *n, int y)
{
    char text[NOTE_TEXT_MAX + sizeof ELLIPSIS];
    const int width = svg_layout_text(n);
    const bool whole = n->letters >= (int)strlen(n->note->text);
    snprintf(text, sizeof text, "%.*s%s", whole ? n->letters : n->letters - 1, n->note->text,
             whole ? "" : ELLIPSIS);
    put_rect(p, n->text - 1, y - 9, width, 11, " fill=\"#ffffff\"");
    fprintf(p->out, "<text class=\"note\" font-size=\"9.5\" fill=\"%s\" x=\"%d\" y=\"%d\"%s>",
            note_colours[n->note->kind], n->before ? n->text + width : n->text, y,
            n->before ? " text-anchor=\"end\"" : "");
    xml_text(p->out, text);
    fputs("</text>\n", p->out);
}

/* Draws notes below the waves of a node, at the end of the bit. */
static void draw_node_notes(const pen *p, unsigned node, int top)
{
    for (size_t i = 0; i < p->layout.note_count; i++) {
        const placed_note *n = &p->layout.notes[i];
        if (in_lane(p, n, node))
            fprintf(p->out, "<path d=\"M%d %dV%d\" stroke=\"%s\"/>\n", n->x, top - SVG_WAVE,
                    top + (int)(n->level + 1) * SVG_NOTE - 3, note_colours[n->note->kind]);
    }
    for (size_t i = 0; i < p->layout.note_count; i++) {
        const placed_note *n = &p->layout.notes[i];
        if (in_lane(p, n, node))
            draw_note_text(p, n, top + (int)(n->level + 1) * SVG_NOTE - 3);
    }
}

/* Draws hits above the wire: a hand that points to the bit, and a line through all lanes. */
static void draw_hits(pen *p)
{
    const int bottom = p->y + svg_layout_faults(p->row);
    const int end = p->row->y + p->row->height - SVG_GAP;
    fputs("<g class=\"rules\">\n", p->out);
    for (size_t i = 0; i < p->layout.note_count; i++) {
        const placed_note *n = &p->layout.notes[i];
        if (!in_lane(p, n, NOTE_OF_BUS))
            continue;
        int top = bottom - (int)(n->level + 1) * SVG_NOTE + 3;
        fprintf(p->out, "<path d=\"M%d %dV%d\" stroke=\"" FAULT "\"/>\n", n->x, top, bottom - 5);
        if (n->same)
            put_line(p, n->x, top, n->joined, top, " class=\"joint\" stroke=\"" FAULT "\"");
        fprintf(p->out, "<path class=\"hit\" d=\"M%d %dh8l-4 6z\" fill=\"" FAULT "\"/>\n", n->x - 4,
                bottom - 6);
        fprintf(p->out, "<path d=\"M%d %dV%d\" stroke=\"" FAULT "\" stroke-dasharray=\"1 3\"/>\n",
                n->x, bottom, end);
    }
    for (size_t i = 0; i < p->layout.note_count; i++) {
        const placed_note *n = &p->layout.notes[i];
        if (in_lane(p, n, NOTE_OF_BUS) && !n->same)
            draw_note_text(p, n, bottom - (int)n->level * SVG_NOTE - 4);
    }
    fputs("</g>\n", p->out);
    p->y = bottom;
}

/* ---- Nodes ----------------------------------------------------------------------------------- */

/* Draws the name left of the lane, valid at the start of the row. */
static void draw_node_name(const pen *p, unsigned node)
{
    const char *name = p->svg->config->nodes[node].name;
    size_t first = p->row->first;
    const cw_bit_node *last = first > 0 ? &p->svg->bits[first - 1].nodes[node] : NULL;
    cw_state state = last ? last->state : p->svg->before[node].state;
    unsigned tec = last ? last->tec : p->svg->before[node].tec;
    unsigned rec = last ? last->rec : p->svg->before[node].rec;
    char text[SVG_LABEL_MAX];
    put_text(p, SVG_MARGIN, p->y + 13, SVG_NAME_FONT " font-size=\"11\" font-weight=\"bold\"",
             name);
    snprintf(text, sizeof text, "TEC %u, REC %u", tec, rec);
    put_text(p, SVG_MARGIN, p->y + 25, " font-size=\"9\" fill=\"" FAINT "\"", text);
    if (state != CW_STATE_ERROR_ACTIVE)
        put_text(p, SVG_MARGIN, p->y + 36, " font-size=\"9\" fill=\"" STATE "\"",
                 cw_state_name(state));
}

/* Draws what the node does by its own clock. */
static void draw_inside(const pen *p, unsigned node, int top)
{
    const inside_list *in = p->svg->inside;
    const size_t end = inside_before(in, p->row->end);
    int last = INSIDE_NONE;
    fputs("<g class=\"inside\">\n", p->out);
    for (size_t i = inside_before(in, p->row->first); i < end; i++)
        if (in->list[i].node == node)
            inside_draw(p->out, &in->list[i], bit_x(p, in->list[i].bit), top,
                        bit_width(p, in->list[i].bit), &last);
    fputs("</g>\n", p->out);
}

/* Draws a node: what it takes the bits for, the levels that it drives and samples, and notes. */
static void draw_node(pen *p, unsigned node)
{
    const int top = p->y + SVG_BAND + 4;
    fprintf(p->out, "<g class=\"node %s\">\n", p->svg->config->nodes[node].name);
    draw_node_name(p, node);
    draw_parts(p, node);
    draw_faults(p, top, node_is_faulty, node);
    const level_lane sampled = {sampled_level, INSIDE_SAMPLE, node};
    const level_lane driven = {driven_level, INSIDE_DRIVE, node};
    draw_wave(p, top, &sampled, " class=\"sampled\" stroke=\"" SAMPLED "\"");
    draw_wave(p, top, &driven, " class=\"driven\" stroke=\"" DRIVEN "\" stroke-width=\"2\"");
    if (p->svg->inside)
        draw_inside(p, node, top + SVG_WAVE + 2);
    draw_node_notes(p, node, top + SVG_WAVE + 2 + p->row->inside);
    fputs("</g>\n", p->out);
    p->y += svg_layout_node(p->row, node);
}

/* ---- The picture ----------------------------------------------------------------------------- */

/* Hits are above all wires and nodes, since their lines go through all of these. */
static void draw_row(pen *p)
{
    p->y = p->row->y;
    fputs("<g class=\"row\">\n", p->out);
    draw_axis(p);
    draw_hits(p);
    for (unsigned wire = 0; wire < p->row->wires; wire++)
        draw_wire(p, wire);
    for (unsigned i = 0; i < p->svg->config->node_count; i++)
        draw_node(p, i);
    fputs("</g>\n", p->out);
}

/* Draws the title; `to` is the requested end of the picture. */
static void draw_title(const pen *p, uint64_t to)
{
    const cfg *config = p->svg->config;
    const cw_bit_view *first = &p->svg->bits[0];
    uint64_t end = p->svg->bits[p->svg->count - 1].end;
    char from[SVG_LABEL_MAX];
    char until[SVG_LABEL_MAX];
    char text[CAPTION_MAX];
    print_us(from, first->start);
    print_us(until, end);
    char data[SVG_LABEL_MAX] = "";
    if (p->svg->dbitrate_bps)
        snprintf(data, sizeof data, " and %" PRIu32, p->svg->dbitrate_bps);
    int used = snprintf(text, sizeof text, "%" PRIu32 "%s bit/s, %s to %s \xC2\xB5s",
                        config->bitrate_bps, data, from, until);
    print_us(until, to);
    if (to != CW_NEVER && end < to)
        snprintf(text + used, sizeof text - (size_t)used,
                 " (the run ended before %s \xC2\xB5s)", until);
    put_text(p, SVG_MARGIN, 20, " font-size=\"13\" font-weight=\"bold\"", config->bus_name);
    put_text(p, p->layout.width - SVG_MARGIN, 20, " text-anchor=\"end\"", text);
}

/* Explains the bar above fast bits, and that their width is to scale. */
static void draw_rate_legend(const pen *p, int x, int y)
{
    char text[SVG_LABEL_MAX + 64];
    snprintf(text, sizeof text,
             "begun at the data rate, %" PRIu32 " bit/s; all bits are to scale",
             p->svg->dbitrate_bps);
    put_rect(p, x, y - 5, 18, 4, " fill=\"" DATA_RATE "\"");
    put_text(p, x + 23, y, "", text);
}

/* Writes what colours and signs mean. It has further lines for own clocks and for a data rate. */
static void draw_legend(const pen *p)
{
    int y = p->layout.height - 10;
    int x = SVG_MARGIN + p->layout.labels;
    y -= ((p->svg->inside != NULL) + (p->svg->dbitrate_bps != 0)) * SVG_LEGEND_LINE;
    fputs("<g class=\"legend\" font-size=\"9.5\" fill=\"" FAINT "\">\n", p->out);
    put_line(p, x, y - 3, x + 18, y - 3, " stroke=\"" DRIVEN "\" stroke-width=\"2\"");
    put_text(p, x + 23, y, "", "driven");
    put_line(p, x + 78, y - 3, x + 96, y - 3, " stroke=\"" SAMPLED "\"");
    put_text(p, x + 101, y, "", "sampled");
    put_rect(p, x + 164, y - 11, 9, 14, " fill=\"#3d3d3d\"");
    put_text(p, x + 168, y - 1, " fill=\"#ffffff\" text-anchor=\"middle\"", "s");
    put_text(p, x + 179, y, "", "stuff bit");
    put_rect(p, x + 246, y - 11, 9, 14,
             " fill=\"" FAULT "\" fill-opacity=\".25\" stroke=\"" FAULT "\"");
    put_text(p, x + 261, y, "", "level changed by a fault");
    put_rect(p, x + 404, y - 11, 14, 14, " fill=\"#a9cdf0\"");
    put_text(p, x + 423, y, "", "transmitter");
    put_rect(p, x + 494, y - 11, 14, 14, " fill=\"#d4e6f7\"");
    put_text(p, x + 513, y, "", "receiver");
    if (p->svg->inside)
        put_text(p, x, y += SVG_LEGEND_LINE, "",
                 "below: time quanta, sample points (longer; secondary ones broken), "
                 "synchronisations with phase errors");
    if (p->svg->dbitrate_bps)
        draw_rate_legend(p, x, y + SVG_LEGEND_LINE);
    fputs("</g>\n", p->out);
}

bool svg_write(FILE *out, const svg *self, uint64_t to)
{
    pen p = {.out = out, .svg = self};
    bool good = svg_layout_make(&p.layout, &self->notes, self->bits, self->count,
                                self->inside != NULL, self->dbitrate_bps != 0);
    if (good) {
        fprintf(out,
                "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%d\" height=\"%d\" "
                "viewBox=\"0 0 %d %d\" font-family=\"Helvetica,Arial,'DejaVu Sans',sans-serif\" "
                "font-size=\"10\" fill=\"" INK "\">\n",
                p.layout.width, p.layout.height, p.layout.width, p.layout.height);
        put_rect(&p, 0, 0, p.layout.width, p.layout.height, " fill=\"#ffffff\"");
        draw_title(&p, to);
        for (size_t r = 0; r < p.layout.row_count; r++) {
            p.row = &p.layout.rows[r];
            draw_row(&p);
        }
        draw_legend(&p);
        fputs("</svg>\n", out);
    }
    svg_layout_free(&p.layout);
    return good;
}
