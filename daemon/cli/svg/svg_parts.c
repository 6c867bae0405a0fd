/* SPDX-License-Identifier: MIT
 *
 * svg_parts.c - colours and labels of the parts of a frame in a picture.
 */
#include "cli/svg/svg_parts.h"

#include <stdio.h>
#include <string.h>

#define VALUE_MAX 20 /* bytes of a value with the final 0 */

/* Returns colours and labels of a field, the longest label first: the one that fits is taken. */
static const svg_style *field_style(cw_field field)
{
    static const svg_style styles[CW_FIELD_COUNT] = {
        [CW_FIELD_SOF] = {"#d7dbe0", INK, {"sof"}},
        [CW_FIELD_ID] = {"#a9cdf0", INK, {"id"}},
        [CW_FIELD_SRR] = {"#a9cdf0", INK, {"srr"}},
        [CW_FIELD_IDE] = {"#c3c4ee", INK, {"ide"}},
        [CW_FIELD_RTR] = {"#a9cdf0", INK, {"rtr"}},
        [CW_FIELD_R1] = {"#c3c4ee", INK, {"r1"}},
        [CW_FIELD_R0] = {"#c3c4ee", INK, {"r0"}},
        [CW_FIELD_FDF] = {"#c3c4ee", INK, {"fdf"}},
        [CW_FIELD_RES] = {"#c3c4ee", INK, {"res"}},
        [CW_FIELD_BRS] = {"#e3c8ee", INK, {"brs"}},
        [CW_FIELD_ESI] = {"#e3c8ee", INK, {"esi"}},
        [CW_FIELD_DLC] = {"#c3c4ee", INK, {"dlc"}},
        [CW_FIELD_DATA] = {"#b2deb0", INK, {"data"}},
        [CW_FIELD_STUFF_COUNT] = {"#fbe6c4", INK, {"stuff count", "count", "sc"}},
        [CW_FIELD_CRC] = {"#f7d49c", INK, {"crc"}},
        [CW_FIELD_FIXED_STUFF] = {"#e8b765", INK, {"fixed stuff", "fixed", "fs"}},
        [CW_FIELD_CRC_DELIMITER] = {"#d7dbe0", INK, {"crc delimiter", "del"}},
        [CW_FIELD_ACK_SLOT] = {"#9fdcd6", INK, {"ack slot", "ack"}},
        [CW_FIELD_ACK_DELIMITER] = {"#d7dbe0", INK, {"ack delimiter", "del"}},
        [CW_FIELD_EOF] = {"#d7dbe0", INK, {"eof"}},
        [CW_FIELD_INTERMISSION] = {"#ececec", INK, {"intermission", "interm.", "int.", "int"}},
        [CW_FIELD_SUSPEND] = {"#ececec", INK, {"suspend", "susp."}},
        [CW_FIELD_ERROR_DELIMITER] = {"#f6cfd0",
                                      INK,
                                      {"error delimiter", "delimiter", "delim.", "del"}},
        [CW_FIELD_OVERLOAD_FLAG] = {"#d97a14", "#ffffff", {"overload flag", "overload", "ovl"}},
        [CW_FIELD_OVERLOAD_DELIMITER] = {"#f8dfc2",
                                         INK,
                                         {"overload delimiter", "delimiter", "delim.", "del"}},
    };
    return &styles[field];
}

/* Returns the style of a phase without a field. */
static const svg_style *phase_style(cw_mac_phase phase)
{
    static const svg_style styles[CW_MAC_PHASE_COUNT] = {
        [CW_MAC_OFF] = {"#cccccc", INK, {"off the bus", "off"}},
        [CW_MAC_INTEGRATING] = {"#f2f2f2", FAINT, {"integrating", "integr."}},
        [CW_MAC_IDLE] = {"#ffffff", FAINT, {"idle"}},
        [CW_MAC_ERROR_ACTIVE] = {ERROR_RED,
                                 "#ffffff",
                                 {"active error flag", "error flag", "error", "err"}},
        [CW_MAC_ERROR_PASSIVE] = {"#ee9aa0",
                                  INK,
                                  {"passive error flag", "passive", "pass.", "err"}},
        [CW_MAC_ERROR_WAIT] = {"#f6cfd0", INK, {"waits for recessive", "waits"}},
        [CW_MAC_OVERLOAD_WAIT] = {"#f8dfc2", INK, {"waits for recessive", "waits"}},
        [CW_MAC_BUS_OFF] = {"#444444", "#ffffff", {"bus-off"}},
        [CW_MAC_RECOVERING] = {"#888888", "#ffffff", {"recovering", "recov."}},
        [CW_MAC_ASLEEP] = {"#c9d3e6", INK, {"asleep"}},
    };
    return &styles[phase];
}

const svg_style *svg_part_style(const bit_part *part)
{
    bool by_phase = part->field == CW_FIELD_NONE || part->field == CW_FIELD_ERROR_FLAG;
    return by_phase ? phase_style(part->phase) : field_style(part->field);
}

/* Returns the bits of a part that begins at this place, and its number of hexadecimal digits; 0
 * digits for parts without a value. */
static unsigned value_bits(const cw_place *place, unsigned *digits)
{
    unsigned bits = 0;
    if (place->field == CW_FIELD_ID && place->index == 0)
        bits = 11;
    else if (place->field == CW_FIELD_ID && place->index == 11)
        bits = 18;
    else if ((place->field == CW_FIELD_DLC || place->field == CW_FIELD_STUFF_COUNT) &&
             place->index == 0)
        bits = 4;
    else if (place->field == CW_FIELD_DATA && place->index % 8 == 0)
        bits = 8;
    else if (place->field == CW_FIELD_CRC && place->index == 0)
        bits = 15; /* in CAN FD frames fixed stuff bits divide it */
    *digits = (bits + 3) / 4;
    return bits;
}

bool svg_same_part(const cw_bit_view *bits, unsigned node, size_t bit)
{
    bit_part before = bit_part_of(&bits[bit - 1], node);
    bit_part here = bit_part_of(&bits[bit], node);
    return bit_part_same(&before, &here);
}

/* Prints the node's value of the part that contains bit `first`. Returns false when the picture
 * lacks some of its bits, or an error cut it off. */
static bool part_value(char out[VALUE_MAX], const cw_bit_view *bits, size_t count, unsigned node,
                       size_t first)
{
    unsigned digits;
    unsigned long value = 0;
    unsigned seen = 0;
    while (first > 0 && svg_same_part(bits, node, first))
        first--;
    unsigned wanted = value_bits(&bits[first].nodes[node].place, &digits);
    for (size_t b = first; b < count && (b == first || svg_same_part(bits, node, b)); b++) {
        if (bits[b].nodes[node].place.stuff)
            continue;
        value = value << 1 | (bits[b].sampled >> node & 1u);
        seen++;
    }
    snprintf(out, VALUE_MAX, "%0*lX", (int)digits, value);
    return wanted > 0 && seen == wanted;
}

/* Writes a label; returns true when it is short enough. */
static bool try_label(char out[SVG_LABEL_MAX], int letters, const char *begin, const char *end)
{
    snprintf(out, SVG_LABEL_MAX, "%s%s%s", begin, *begin && *end ? " " : "", end);
    return (int)strlen(out) <= letters;
}

void svg_label(char out[SVG_LABEL_MAX], const cw_bit_view *bits, size_t count, unsigned node,
               size_t first, int letters, bool with_value)
{
    bit_part part = bit_part_of(&bits[first], node);
    const char *const *labels = svg_part_style(&part)->labels;
    bool data = part.field == CW_FIELD_DATA;
    char value[VALUE_MAX];
    char name[BIT_PART_TEXT_MAX];
    bit_part_print(name, &part);
    if (with_value && part_value(value, bits, count, node, first) &&
        (try_label(out, letters, name, value) ||
         (data && try_label(out, letters, strchr(name, '['), value)) ||
         try_label(out, letters, "", value)))
        return;
    if (data && try_label(out, letters, name, ""))
        return;
    for (size_t i = 0; i < SVG_LABELS_MAX && labels[i]; i++)
        if (try_label(out, letters, labels[i], ""))
            return;
    out[0] = '\0';
}
