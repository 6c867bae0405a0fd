/* SPDX-License-Identifier: MIT
 *
 * main.c - writes layout.h and tables.c, which follow from the table of parts.
 *
 * usage: generate layout|tables
 *
 * It runs when canwire is built. Positions come from a walk through a frame without data. CRC and
 * stuffing of whole bytes are computed bit by bit.
 */
#include "format/crc.h"
#include "format/parts.h"
#include "format/spans.h"
#include "format/walk.h"

#include <stdio.h>
#include <string.h>

#define DATA_BITS_MAX (8 * CW_FRAME_DATA_MAX)
#define CLASSICAL_DATA_BITS_MAX (8 * CW_CLASSICAL_DATA_MAX)

/* The numbers of cw_format(). */
enum { BASE, EXTENDED, FD_BASE, FD_EXTENDED };

static const char *const format_names[CW_FORMATS] = {"BASE", "EXTENDED", "FD_BASE", "FD_EXTENDED"};

static const char *const head_names[CW_PART_DATA] = {
    [CW_PART_SOF] = "SOF",
    [CW_PART_BASE_ID] = "BASE_ID",
    [CW_PART_SRR_RTR] = "SRR_RTR",
    [CW_PART_IDE] = "IDE",
    [CW_PART_EXTENDED_ID] = "EXTENDED_ID",
    [CW_PART_RTR] = "RTR",
    [CW_PART_R1] = "R1",
    [CW_PART_EXTENDED_R0] = "EXTENDED_R0",
    [CW_PART_R0] = "R0",
    [CW_PART_RES] = "RES",
    [CW_PART_BRS] = "BRS",
    [CW_PART_ESI] = "ESI",
    [CW_PART_DLC] = "DLC",
};

/* A frame without data. */
typedef struct layout {
    cw_form form;
    bool has[CW_PART_COUNT];
    unsigned at[CW_PART_COUNT];
    unsigned bits; /* all of them */
} layout;

/* Walks through a frame without data and notes the parts that it has and where each begins. */
static layout find_layout(unsigned format)
{
    const unsigned extended = format == EXTENDED || format == FD_EXTENDED ? CW_FRAME_EXTENDED : 0;
    const unsigned fd = format == FD_BASE || format == FD_EXTENDED ? CW_FRAME_FD : 0;
    const cw_frame frame = {.flags = (uint8_t)(extended | fd)};
    layout l = {.bits = 0};
    cw_walk w = cw_walk_begin(&frame);
    l.form = w.form;
    for (; w.part != CW_PART_END; cw_walk_on(&w), l.bits++)
        if (w.index == 0) {
            l.has[w.part] = true;
            l.at[w.part] = l.bits;
        }
    l.has[CW_PART_DATA] = true;
    l.at[CW_PART_DATA] = l.at[fd ? CW_PART_STUFF_COUNT : CW_PART_CRC];
    return l;
}

/* Returns the bit behind a part. */
static unsigned generate_end_of(const layout *l, cw_part part)
{
    return l->at[part] + cw_part_bits(part, &l->form);
}

/* Returns the bits after the part with an effect. */
static unsigned bits_after(const layout *l, cw_effect effect)
{
    unsigned end = 0;
    for (unsigned part = 0; part < CW_PART_COUNT; part++)
        if (cw_parts[part].effect == effect)
            end = generate_end_of(l, (cw_part)part);
    return l->bits - end;
}

/* Returns the end of the last part with a flag. */
static unsigned flag_end(const layout *l, unsigned flag)
{
    unsigned end = 0;
    for (unsigned part = 0; part < CW_PART_COUNT; part++)
        if (l->has[part] && cw_part_is((cw_part)part, flag))
            end = generate_end_of(l, (cw_part)part);
    return end;
}

/* ---- layout.h -------------------------------------------------------------------------------- */

static void define(const char *name, const char *what, unsigned value)
{
    printf("#define CW_%s%s %uu\n", name, what, value);
}

/* Defines the length of a format's header, the end of its arbitration field, and where each part of
 * the header is in a number. */
static void define_head(unsigned format)
{
    const layout l = find_layout(format);
    char shift[64];
    printf("\n");
    define(format_names[format], "_HEAD_BITS", l.at[CW_PART_DATA]);
    define(format_names[format], "_ARBITRATION_END", flag_end(&l, CW_PART_ARBITRATION));
    for (unsigned part = 0; part < CW_PART_DATA; part++) {
        snprintf(shift, sizeof shift, "_SHIFT_%s", head_names[part]);
        if (l.has[part])
            define(format_names[format], shift,
                   l.at[CW_PART_DATA] - generate_end_of(&l, (cw_part)part));
    }
}

/* Returns the wire bits of the fixed-stuffed parts of an FD frame (D4). */
static unsigned fixed_stuffed(unsigned data_bits, bool non_iso)
{
    const cw_form form = {.data_bits = (uint16_t)data_bits, .fd = true, .non_iso = non_iso};
    const unsigned bits =
        cw_part_bits(CW_PART_STUFF_COUNT, &form) + cw_part_bits(CW_PART_CRC, &form);
    return bits + (bits + CW_FIXED_STUFF_DISTANCE - 1) / CW_FIXED_STUFF_DISTANCE;
}

/* Defines the lengths of parts, and of the shortest and longest frames. */
static void define_lengths(void)
{
    const layout base = find_layout(BASE), extended = find_layout(EXTENDED);
    const layout fd = find_layout(FD_EXTENDED);
    const unsigned tail = base.bits - flag_end(&base, CW_PART_STUFFED);
    const unsigned fd_tail = fd.bits - flag_end(&fd, CW_PART_STUFFED);
    const unsigned stuffed = extended.bits - tail + CLASSICAL_DATA_BITS_MAX;
    const unsigned fd_stuffed = fd.at[CW_PART_DATA] + DATA_BITS_MAX;
    define("BASE_ID", "_BITS", cw_parts[CW_PART_BASE_ID].bits);
    define("EXTENDED_ID", "_BITS", cw_parts[CW_PART_EXTENDED_ID].bits);
    define("DLC", "_BITS", cw_parts[CW_PART_DLC].bits);
    define("CRC", "_BITS", cw_part_bits(CW_PART_CRC, &base.form));
    define("TAIL", "_BITS", tail);
    define("FD_TAIL", "_BITS", fd_tail);
    define("FD_CRC17", "_WIRE_BITS", fixed_stuffed(0, false));
    define("FD_CRC21", "_WIRE_BITS", fixed_stuffed(DATA_BITS_MAX, false));
    define("NON_ISO_CRC17", "_WIRE_BITS", fixed_stuffed(0, true));
    define("NON_ISO_CRC21", "_WIRE_BITS", fixed_stuffed(DATA_BITS_MAX, true));
    define("AFTER_ACK", "_BITS", bits_after(&base, CW_EFFECT_JUDGE_ACK));
    define("FD_AFTER_ACK", "_BITS", bits_after(&fd, CW_EFFECT_JUDGE_ACK));
    define("AFTER_ACCEPT", "_BITS", bits_after(&base, CW_EFFECT_ACCEPT));
    define("FRAME", "_BITS_MIN", base.bits);
    define("CLASSICAL_FRAME", "_BITS_MAX", CW_STUFFED_BITS_MAX(stuffed) + tail);
    define("FRAME", "_BITS_MAX",
           CW_STUFFED_BITS_MAX(fd_stuffed - 1) + 1 + fixed_stuffed(DATA_BITS_MAX, false) + fd_tail);
    define("CRC", "_TABLE_BYTES", (stuffed + 7) / 8);
}

static const char layout_begin[] =
    "/* Written by lib/format/generate, from the table of parts (parts.c). */\n"
    "#ifndef CANWIRE_FORMAT_LAYOUT_H\n"
    "#define CANWIRE_FORMAT_LAYOUT_H\n"
    "\n"
    "/* Bits of parts; of the tail, which is not stuffed; behind the ACK slot and behind the bit\n"
    " * after which receivers accept the frame (M7); of a whole frame on the wire. */\n";

static const char head_begin[] =
    "\n"
    "/* SOF to the DLC as a number: its bits, how many of them have passed when nobody can lose\n"
    " * arbitration any more, and how far each part is shifted to the left. */";

/* Writes format/layout.h, the constants of the table of parts. */
static void write_layout(void)
{
    printf("%s", layout_begin);
    define_lengths();
    printf("%s", head_begin);
    for (unsigned format = 0; format < CW_FORMATS; format++)
        define_head(format);
    printf("\n#endif\n");
}

/* ---- tables.c: positions --------------------------------------------------------------------- */

typedef struct span {
    unsigned first, bits, split, gap, behind;
} span;

/* Adds a part to its field; other parts may lie between two parts of a field. */
static void add_part(span *s, const layout *l, cw_part part)
{
    const unsigned at = l->at[part];
    if (s->bits == 0) {
        s->first = at;
        s->behind = part > CW_PART_CRC           ? CW_BEHIND_CRC
                    : part > CW_PART_STUFF_COUNT ? CW_BEHIND_STUFF_COUNT
                    : part > CW_PART_DATA        ? CW_BEHIND_DATA
                                                 : 0;
    } else if (at > s->first + s->bits) {
        s->split = s->bits;
        s->gap = at - s->first - s->bits;
    }
    s->bits += cw_part_bits(part, &l->form);
}

/* Writes the bits that each field of a format has, without stuff bits. */
static void write_spans(unsigned format)
{
    const layout l = find_layout(format);
    const bool extended = format == EXTENDED || format == FD_EXTENDED;
    span spans[CW_FIELD_COUNT] = {{.bits = 0}};
    for (unsigned part = 0; part < CW_PART_COUNT; part++)
        if (l.has[part])
            add_part(&spans[cw_part_place((cw_part)part, 0, extended, l.form.fd).field], &l,
                     (cw_part)part);
    printf("    {\n");
    for (unsigned f = 0; f < CW_FIELD_COUNT; f++)
        printf("        {%u, %u, %u, %u, %u},\n", spans[f].first, spans[f].bits, spans[f].split,
               spans[f].gap, spans[f].behind);
    printf("    },\n");
}

/* Writes the first bit of each part of a format. */
static void write_places(unsigned format)
{
    const layout l = find_layout(format);
    printf("    {");
    for (unsigned part = 0; part < CW_PART_COUNT; part++)
        printf("%u, ", l.at[part]);
    printf("},\n");
}

/* Writes where parts and fields are, in all formats. */
static void write_positions(void)
{
    printf("\nconst uint8_t cw_part_at[CW_FORMATS][CW_PART_COUNT] = {\n");
    for (unsigned format = 0; format < CW_FORMATS; format++)
        write_places(format);
    printf("};\n\nconst cw_field_span cw_field_spans[CW_FORMATS][CW_FIELD_COUNT] = {\n");
    for (unsigned format = 0; format < CW_FORMATS; format++)
        write_spans(format);
    printf("};\n");
}

/* ---- tables.c: whole bytes ------------------------------------------------------------------- */

/* Returns the share of a byte in the CRC, when so many bytes follow it. */
static unsigned crc_of(unsigned byte, unsigned bytes_behind)
{
    uint16_t crc = 0;
    for (unsigned n = 0; n + CW_CRC15_BITS < 8 * (bytes_behind + 1); n++)
        crc = cw_crc15_next(crc, n < 8 ? (byte >> (7 - n)) & 1u : 0);
    return crc;
}

/* Writes the CRC-15 of each byte with so many bytes behind it. */
static void write_crcs(void)
{
    const layout l = find_layout(EXTENDED);
    const unsigned bytes = (generate_end_of(&l, CW_PART_CRC) + CLASSICAL_DATA_BITS_MAX + 7) / 8;
    printf("\nconst uint16_t cw_crc_table[CW_CRC_TABLE_BYTES][256] = {\n");
    for (unsigned behind = 0; behind < bytes; behind++) {
        printf("    {");
        for (unsigned byte = 0; byte < 256; byte++)
            printf("%s0x%04X,", byte % 8 ? " " : "\n        ", crc_of(byte, behind));
        printf("\n    },\n");
    }
    printf("};\n");
}

/* Returns the CRC of an FD frame after a byte. All bits are reversed: the first one is the lowest,
 * in the byte as in the CRC. */
static uint32_t reversed_crc_of(unsigned byte, unsigned bits, uint32_t polynomial)
{
    uint32_t crc = 0, reversed = 0;
    for (unsigned n = 0; n < 8; n++)
        crc = cw_crc_next(crc, (byte >> n) & 1u, bits, polynomial);
    for (unsigned n = 0; n < bits; n++)
        reversed |= ((crc >> n) & 1u) << (bits - 1 - n);
    return reversed;
}

/* Writes the table of one CRC of FD frames, bits in reverse order. */
static void write_fd_crc(const char *name, unsigned bits, uint32_t polynomial)
{
    printf("\nconst uint32_t %s[256] = {", name);
    for (unsigned byte = 0; byte < 256; byte++)
        printf("%s0x%06lX,", byte % 8 ? " " : "\n    ",
               (unsigned long)reversed_crc_of(byte, bits, polynomial));
    printf("\n};\n");
}

static void write_fd_crcs(void)
{
    write_fd_crc("cw_crc17_table", CW_CRC17_BITS, CW_CRC17_POLYNOMIAL);
    write_fd_crc("cw_crc21_table", CW_CRC21_BITS, CW_CRC21_POLYNOMIAL);
}

/* The wire bits of a byte and the state after it. */
typedef struct stuffed_byte {
    unsigned long long wire; /* the last one in bit 63 */
    unsigned bits;
    unsigned state;
} stuffed_byte;

/* Adds a level behind the others. The first one ends up lowest. */
static void generate_put(stuffed_byte *s, unsigned level)
{
    s->wire = s->wire >> 1 | (unsigned long long)level << 63;
    s->bits++;
}

/* Stuffs a byte that follows a run of equal levels (F7). state: the last level times four, and the
 * length of the run less one. */
static stuffed_byte stuff(unsigned state, unsigned byte)
{
    stuffed_byte s = {.bits = 0};
    unsigned last = state / 4, run = state % 4 + 1;
    for (unsigned n = 0; n < 8; n++) {
        const unsigned level = (byte >> (7 - n)) & 1u;
        generate_put(&s, level);
        run = level == last ? run + 1 : 1;
        last = level;
        if (run == CW_STUFF_RUN) {
            last = !level;
            run = 1;
            generate_put(&s, last);
        }
    }
    s.state = 4 * last + run - 1;
    return s;
}

/* Writes the stuffed levels of each byte in each state, and the state behind it. */
static void write_stuffing(void)
{
    printf("\nconst uint64_t cw_stuff_table[CW_STUFF_STATES * 256] = {");
    for (unsigned i = 0; i < 8 * 256; i++) {
        const stuffed_byte s = stuff(i / 256, i % 256);
        printf("%s0x%016llX,", i % 4 ? " " : "\n    ", s.wire | s.bits);
    }
    printf("\n};\n\nconst uint16_t cw_stuff_next[CW_STUFF_STATES * 256] = {");
    for (unsigned i = 0; i < 8 * 256; i++)
        printf("%s0x%03X,", i % 8 ? " " : "\n    ", 256 * stuff(i / 256, i % 256).state);
    printf("\n};\n");
}

/* Writes format/tables.c, the tables for positions, CRC and stuffing. */
static void write_tables(void)
{
    printf("/* Written by lib/format/generate, from the table of parts (parts.c). */\n"
           "#include \"format/tables.h\"\n");
    write_positions();
    write_crcs();
    write_fd_crcs();
    write_stuffing();
}

/* Writes the file that the argument names, layout or tables, to standard output. */
int main(int argc, char **argv)
{
    if (argc == 2 && strcmp(argv[1], "layout") == 0)
        write_layout();
    else if (argc == 2 && strcmp(argv[1], "tables") == 0)
        write_tables();
    else
        return 2;
    return fflush(stdout) == 0 ? 0 : 1;
}
