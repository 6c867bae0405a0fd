/* SPDX-License-Identifier: MIT
 *
 * test_trace.c - recordings: what is read from files of candump, Vector and Wireshark, and what is
 * said about bad ones.
 *
 * Runs at the top of the source tree. tests/traces/candump was written by candump itself.
 */
#include "cases.h"
#include "run/replay.h"
#include "trace/format.h"
#include "trace/frametext.h"
#include "trace/read.h"

#include <inttypes.h>
#include <unistd.h>

#define MADE "tests/traces/candump/"

/* ---- Files as text --------------------------------------------------------------------------- */

static const char *const kind_names[TRACE_KIND_COUNT] = {"frame", "damaged", "error", "fd",
                                                         "xl",    "other",   "mark"};

/* Prints an entry: "LINE SECONDS CHANNEL FRAME", or its kind without a frame; "-" without time. */
static void print_record(FILE *out, const trace_reader *reader, const trace_record *r)
{
    char frame[FRAME_TEXT_MAX];
    if (r->kind == TRACE_DAMAGED) {
        fprintf(out, "%" PRIu64 " damaged %" PRIu64 ": %s\n", r->place, r->bytes,
                trace_damage(reader));
        return;
    }
    text_print_frame(frame, &r->frame);
    fprintf(out, "%" PRIu64 " ", r->place);
    if (r->timed)
        fprintf(out, "%" PRIu64 ".%09" PRIu64, r->time_ns / 1000000000, r->time_ns % 1000000000);
    else
        fprintf(out, "-");
    const bool shown = r->kind == TRACE_FRAME || r->kind == TRACE_FD_FRAME;
    if (shown)
        assert_true(cw_frame_valid(&r->frame));
    fprintf(out, " %s %s\n", r->channel, shown ? frame : kind_names[r->kind]);
}

/* Returns all entries, and at last the error behind the name of the file; to be freed. */
static char *read_all(const char *file, trace_format format)
{
    char *text = NULL;
    size_t size = 0;
    char problem[TRACE_PROBLEM_MAX];
    FILE *out = open_memstream(&text, &size);
    trace_record record;
    trace_result result = TRACE_BAD;
    assert_non_null(out);
    trace_reader *reader = trace_open(file, format, problem);
    bool any = false; /* entry that is whole */
    while (reader && (result = trace_next(reader, &record)) == TRACE_RECORD) {
        print_record(out, reader, &record);
        any = any || record.kind != TRACE_DAMAGED;
    }
    if (result == TRACE_BAD && !any)
        rewind(out); /* the error is that of the first one */
    if (result == TRACE_BAD) {
        const char *what = reader ? trace_problem(reader) : problem;
        assert_memory_equal(what, file, strlen(file));
        fprintf(out, "bad%s\n", what + strlen(file));
    }
    trace_close(reader);
    fclose(out);
    return text;
}

/* Makes a file with this content; the name is to be freed and the file removed. */
static char *make_file(const void *content, size_t size)
{
    char *name = strdup("/tmp/canwire-test-trace.XXXXXX");
    assert_non_null(name);
    int fd = mkstemp(name);
    assert_true(fd >= 0);
    assert_true(write(fd, content, size) == (ssize_t)size);
    close(fd);
    return name;
}

static void assert_reads(const void *content, size_t size, trace_format format,
                         const char *expected)
{
    FREED char *name = make_file(content, size);
    FREED char *got = read_all(name, format);
    assert_string_equal(got, expected);
    unlink(name);
}

/* ---- candump --------------------------------------------------------------------------------- */

typedef struct made_case {
    const char *file;
    trace_format format;
    const char *expected;
} made_case;

#define LOG_TIMES                                                                                  \
    "1 1795238547.938812000 vcan7 123#DEADBEEF\n"                                                  \
    "2 1795238548.539795000 can-log1 12345678#1122334455667788\n"                                  \
    "3 1795238548.898233000 vcan7 7FF#\n"                                                          \
    "4 1795238549.065544000 vcan7 00A#R\n"                                                         \
    "5 1795238549.115860000 vcan7 00A#R5\n"

/* BRS is only in logs, and on a screen with -x. */
#define FD_BRS "123##100112233445566778899AABB"
#define FD "123##000112233445566778899AABB"

#define WITHOUT_ERRORS                                                                             \
    LOG_TIMES "6 1795238549.508386000 vcan7 " FD_BRS "\n"                                       \
              "7 1795238549.567726000 can-log1 000#41424320\n"

#define SCREEN_WITHOUT_ERRORS                                                                      \
    LOG_TIMES "6 1795238549.508386000 vcan7 " FD "\n"                                              \
              "7 1795238549.567726000 can-log1 000#41424320\n"

#define SCREEN_WITH_ERRORS                                                                         \
    LOG_TIMES "6 1795238549.292758000 can-log1 error\n"                                            \
              "7 1795238549.508386000 vcan7 " FD "\n"                                              \
              "8 1795238549.567726000 can-log1 000#41424320\n"

#define WITH_ERRORS                                                                                \
    LOG_TIMES "6 1795238549.292758000 can-log1 error\n"                                            \
              "7 1795238549.508386000 vcan7 " FD_BRS "\n"                                       \
              "8 1795238549.567726000 can-log1 000#41424320\n"

static const made_case made[] = {
    {MADE "log.log", TRACE_DETECT, WITH_ERRORS},
    {MADE "absolute.txt", TRACE_DETECT, SCREEN_WITH_ERRORS},
    {MADE "date-errors.txt", TRACE_DETECT,
     LOG_TIMES "6 1795238549.292758000 can-log1 error\n"
               "8 1795238549.508386000 vcan7 " FD "\n" /* line 7 explains the error frame */
               "9 1795238549.567726000 can-log1 000#41424320\n"},
    {MADE "log-extra.log", TRACE_DETECT, WITHOUT_ERRORS},
    {MADE "logfile.log", TRACE_DETECT, WITHOUT_ERRORS},
    {MADE "binary.txt", TRACE_DETECT, SCREEN_WITHOUT_ERRORS},
    {MADE "swapped.txt", TRACE_DETECT, SCREEN_WITHOUT_ERRORS},
    {MADE "zero-extra-ascii.txt", TRACE_DETECT,
     "1 0.000000000 vcan7 123#DEADBEEF\n"
     "2 0.600983000 can-log1 12345678#1122334455667788\n"
     "3 0.959421000 vcan7 7FF#\n"
     "4 1.126732000 vcan7 00A#R\n"
     "5 1.177048000 vcan7 00A#R5\n"
     "6 1.569574000 vcan7 " FD_BRS "\n"
     "7 1.628914000 can-log1 000#41424320\n"},
    {MADE "delta.txt", TRACE_CANDUMP_DELTA, /* recorded together with the one before */
     "1 0.000000000 vcan7 123#DEADBEEF\n"
     "2 0.600983000 can-log1 12345678#1122334455667788\n"
     "3 0.959421000 vcan7 7FF#\n"
     "4 1.126732000 vcan7 00A#R\n"
     "5 1.177048000 vcan7 00A#R5\n"
     "6 1.569574000 vcan7 " FD "\n"
     "7 1.628914000 can-log1 000#41424320\n"},
    {MADE "no-time.txt", TRACE_DETECT,
     "1 - vcan7 123#DEADBEEF\n"
     "2 - can-log1 12345678#1122334455667788\n"
     "3 - vcan7 7FF#\n"
     "4 - vcan7 00A#R\n"
     "5 - vcan7 00A#R5\n"
     "6 - vcan7 " FD "\n"
     "7 - can-log1 000#41424320\n"},
    {MADE "colour.txt", TRACE_DETECT,
     "bad:1:23: an escape sequence: record without colours (-c)\n"},
    {MADE "absent", TRACE_DETECT, "bad: No such file or directory\n"},
    {"tests/traces", TRACE_DETECT, "bad: not a regular file\n"},
    {"/dev/null", TRACE_DETECT, "bad: not a regular file\n"},
};

TEST(files_of_candump_are_read)
{
    for (size_t i = 0; i < COUNT(made); i++) {
        FREED char *got = read_all(made[i].file, made[i].format);
        if (strcmp(got, made[i].expected) != 0)
            print_message("%s\n", made[i].file);
        assert_string_equal(got, made[i].expected);
    }
}

typedef struct text_case {
    const char *text;
    const char *expected;
} text_case;

#define CANDUMP_LINE                                                                               \
    "expected a line of candump such as '(1436509052.249713) vcan0 123#DEADBEEF' or "              \
    "'(000.000000)  vcan0  123   [4]  DE AD BE EF'\n"
#define CANDUMP_STAMP_TEXT                                                                         \
    "expected a time such as (1436509052.249713), (000.000000) or (2024-02-29 12:34:56.000000)"
#define CANDUMP_STAMP CANDUMP_STAMP_TEXT "\n"
#define CANDUMP_LENGTH "expected a length: [0] to [8], {9} to {F}, [00] to [64] for CAN FD\n"

#define EIGHT "0011223344556677"

static const text_case candump[] = {
    {"", ""},
    {"\n  \n", ""},
    {"(1.5) a 7ff#aabb\n", "1 1.500000000 a 7FF#AABB\n"},
    {"(1.5) a 123#R4", "1 1.500000000 a 123#R4\n"}, /* no newline at the end */
    {"(1.123456789) a 123#\r\n", "1 1.123456789 a 123#\n"},
    {"(0.0) a 123#1122334455667788_F\n", "1 0.000000000 a 123#1122334455667788_F\n"},
    {"(0.0) a 123#11.22\n", "1 0.000000000 a 123#1122\n"},
    {"(0.0) a 123# R\n(0.0) a 123# T B -\n", "1 0.000000000 a 123#\n2 0.000000000 a 123#\n"},
    {"(0.0) a 123##0\n(0.0) a 12345678##311",
     "1 0.000000000 a 123##0\n2 0.000000000 a 12345678##311\n"},
    {"(0.0) a 123##5" EIGHT EIGHT EIGHT EIGHT EIGHT EIGHT EIGHT EIGHT " R\n",
     "1 0.000000000 a 123##1" EIGHT EIGHT EIGHT EIGHT EIGHT EIGHT EIGHT EIGHT "\n"},
    {"(0.0) a 123##0112233445566778899\n", "1 0.000000000 a 123##0112233445566778899000000\n"},
    {"(0.0) a 00123#81:00:12345678#11\n", "1 0.000000000 a xl\n"},
    {"(0.0) a 20000080#0000000000000000\n", "1 0.000000000 a error\n"},
    {"(2000-02-29 23:59:59.999999) a 123#\n(2000-03-01 00:00:00.5) a 123#\n",
     "1 951868799.999999000 a 123#\n2 951868800.500000000 a 123#\n"},
    {"(1970-01-01 00:00:00.000001)  a  123   [0]\n", "1 0.000001000 a 123#\n"},
    {"  a  123   {F}  00 11 22 33 44 55 66 77\n", "1 - a 123#0011223344556677_F\n"},
    {"  a  123   {9}  remote request\n", "1 - a 123#R8_9\n"},
    {"  a  123   [08]  00 11 22 33 44 55 66 77\n", "1 - a 123##00011223344556677\n"},
    {"  a  RX B E  12345678  [00] \n", "1 - a 12345678##3\n"},
    {"  a  RX - E  123  [10]  00 11 22 33 44 55 66 77 88 99\n",
     "1 - a 123##2001122334455667788990000\n"},
    {"  a  RX B -  123  [2]  AA 55\n", "1 - a 123#AA55\n"},
    {"  a  RX - -  123   [1]  FF   '.'\n", "1 - a 123#FF\n"},
    {"  a  123   [1]  FF\nDROPCOUNT: dropped 3 CAN frames on 'a' socket (total drops 3)\n",
     "1 - a 123#FF\n2 -  other\n"},
    {"  a  123   [2]  AA`55\n", "1 - a 123#55AA\n"},
    {"(0.1) a-very-long-name-of-some-interface 123#\n",
     "1 0.100000000 a-very-long-name-of-some-interf 123#\n"},
    /* bad ones */
    {"(1.5)\n", "bad:1:1: " CANDUMP_LINE},
    {"(1.5) a\n", "bad:1:1: " CANDUMP_LINE},
    {"(1.5 a 123#\n", "bad:1:1: " CANDUMP_STAMP},
    {"(1,5) a 123#\n", "bad:1:1: " CANDUMP_STAMP},
    {"(1.1234567890) a 123#\n", "bad:1:1: " CANDUMP_STAMP},
    {"(99999999999.0) a 123#\n", "bad:1:1: " CANDUMP_STAMP},
    {"(2000-13-01 00:00:00.0) a 123#\n", "bad:1:1: " CANDUMP_STAMP},
    {"(2000-01-01 00:00:61.0) a 123#\n", "bad:1:1: " CANDUMP_STAMP},
    {"(1.5) a 123#\n(1.5) \xC3\xA4 800#\n",
     "1 1.500000000 a 123#\n2 damaged 14: '800#': identifiers have 3 hexadecimal digits (base, up "
     "to 7FF) or 8 (extended, up to 1FFFFFFF)\n"},
    {"(1.5) a 123#1\n", "bad:1:9: '123#1': data bytes have two hexadecimal digits\n"},
    {"(1.5) a 123##1F\n", "bad:1:9: '123##1F': data bytes have two hexadecimal digits\n"},
    {"(1.5) a 123##0" EIGHT EIGHT EIGHT EIGHT EIGHT EIGHT EIGHT EIGHT "00\n",
     "bad:1:9: '123##0" EIGHT EIGHT EIGHT EIGHT EIGHT EIGHT EIGHT EIGHT
     "00': a CAN FD frame has at most 64 data bytes\n"},
    {"(1.5) a 123 [0F] 00\n", "bad:1:13: " CANDUMP_LENGTH},
    {"(1.5) a 123 [65] 00\n", "bad:1:13: " CANDUMP_LENGTH},
    {"(1.5) a 123 [02] 00\n", "bad:1:20: expected 2 data bytes, two digits each\n"},
    {"(1.5) a 123 [02] remote request\n",
     "bad:1:18: expected 2 data bytes, two digits each\n"},
    {"(1.5) a 123#11 x\n", "bad:1:16: expected the end of the line behind the frame\n"},
    {"(1.5) a 1234 [0]\n", "bad:1:9: " CANDUMP_LINE},
    {"(1.5) a 800 [0]\n",
     "bad:1:9: an identifier is at most 7FF with 3 digits and 1FFFFFFF with 8\n"},
    {"(1.5) a C0000000 [0]\n",
     "bad:1:9: an identifier is at most 7FF with 3 digits and 1FFFFFFF with 8\n"},
    {"(1.5) a 123 [9] 00\n", "bad:1:13: " CANDUMP_LENGTH},
    {"(1.5) a 123 {8} 00\n", "bad:1:13: " CANDUMP_LENGTH},
    {"(1.5) a 123 [\n", "bad:1:13: " CANDUMP_LENGTH},
    {"(1.5) a 123\n", "bad:1:12: " CANDUMP_LENGTH},
    {"(1.5) a 123 [2] 00\n", "bad:1:19: expected 2 data bytes, two digits each\n"},
    {"(1.5) a 123 [1] 00 11\n", "bad:1:20: expected the end of the line behind 1 data bytes\n"},
    {"(1.5) a 123 [1] 0G\n", "bad:1:17: expected 1 data bytes, two digits each\n"},
    {"(1.5) a 123 [1] remote requests\n",
     "bad:1:31: expected the end of the line behind 'remote request'\n"},
    {"(1.5) a 123#\n\tstray\n", "1 1.500000000 a 123#\n2 damaged 7: " CANDUMP_LINE},
};

TEST(lines_of_candump_are_read_or_refused)
{
    for (size_t i = 0; i < COUNT(candump); i++)
        assert_reads(candump[i].text, strlen(candump[i].text), TRACE_CANDUMP, candump[i].expected);
}

#define BYTE_ZERO "a byte 0: a crash leaves such bytes, or this is no text\n"

TEST(long_lines_and_zeros_are_refused)
{
    static const char zero[] = "(1.0) a 123#\n(1.0) a 1\0003#\n";
    char line[5000];
    assert_reads(zero, sizeof zero - 1, TRACE_CANDUMP,
                 "1 1.000000000 a 123#\n2 damaged 10: " BYTE_ZERO "2 damaged 3: " BYTE_ZERO);
    memset(line, ' ', sizeof line);
    memcpy(line, "(1.0) a 123#", 12);
    line[4096] = '\n';
    assert_reads(line, 4097, TRACE_CANDUMP, "1 1.000000000 a 123#\n");
    line[4096] = ' ';
    line[4097] = '\n';
    assert_reads(line, 4098, TRACE_CANDUMP, "bad:1:1: this line has more than 4096 bytes\n");
    assert_reads(line, 4097, TRACE_CANDUMP, "bad:1:1: this line has more than 4096 bytes\n");
}

/* Longer than the buffer by far, so that lines lie across its ends. */
TEST(files_longer_than_the_buffer_are_read)
{
    enum { LINES = 20000 };
    FREED char *content = NULL;
    FREED char *expected = NULL;
    size_t size;
    size_t expected_size;
    FILE *in = open_memstream(&content, &size);
    FILE *out = open_memstream(&expected, &expected_size);
    assert_true(in && out);
    for (unsigned i = 1; i <= LINES; i++) {
        fprintf(in, "(%u.%06u) can%u %03X#%.*s\n", i, i, i % 3, i % 0x800, (int)(i % 9 * 2),
                "1122334455667788");
        fprintf(out, "%u %u.%06u000 can%u %03X#%.*s\n", i, i, i, i % 3, i % 0x800, (int)(i % 9 * 2),
                "1122334455667788");
    }
    fclose(in);
    fclose(out);
    assert_true(size > 400000);
    assert_reads(content, size, TRACE_DETECT, expected);
}

/* ---- ASC ------------------------------------------------------------------------------------- */

#define HEX "date Sat Sep 30 10:06:13.191 am 2017\nbase hex  timestamps absolute\n"
#define DEC "base dec  timestamps relative\n"
#define ASC_LINE                                                                                   \
    "expected an event such as '0.015991 1  123  Rx  d 2 00 11', a comment (//), or one of date, " \
    "base, internal events logged, Begin Triggerblock, End TriggerBlock\n"

#define ZEROS_31                                                                                   \
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
#define ZEROS_62 ZEROS_31 ZEROS_31
#define HEX_ZEROS_31 "00000000000000000000000000000000000000000000000000000000000000"
#define HEX_ZEROS_62 HEX_ZEROS_31 HEX_ZEROS_31

static const text_case asc[] = {
    {HEX
     "internal events logged\n// version 9.0.0\nBegin Triggerblock Sat Sep 30\n"
     "   0.000000 Start of measurement\n"
     "   0.015991 1  54C5638x        Tx   d 8 00 11 22 33 44 55 66 77 Length = 0 ID = 88888888x\n"
     "   0.016000 2  7ff             Rx   d 1 FF  Length = 118000 BitCount = 62 ID = 2047\n"
     "   1.5 1  123             Rx   r\n"
     "   1.6 1  123             Rx   r 5 Length = 118000 BitCount = 62 ID = 291\n"
     "   1.7 1  123             Rx   d F 00 11 22 33 44 55 66 77\n"
     "End TriggerBlock\n",
     "6 0.000000000  mark\n7 0.015991000 1 054C5638#0011223344556677\n"
     "8 0.016000000 2 7FF#FF\n9 1.500000000 1 123#R\n10 1.600000000 1 123#R5\n"
     "11 1.700000000 1 123#0011223344556677_F\n"},
    {DEC "no internal events logged\r\n 1.0 1 2047 Rx d 2 255 16\r\n 0.5 1 536870911x Rx d 0\r\n",
     "3 1.000000000 1 7FF#FF10\n4 1.500000000 1 1FFFFFFF#\n"},
    {HEX "1.0 1 ErrorFrame\n1.0 2 ErrorFrame ECC: 10100010\n",
     "3 1.000000000 1 error\n4 1.000000000 2 error\n"},
    {HEX "1.0 CANFD   1 Rx  12  1 0 9 12 00 00 00 00 00 00 00 00 00 00 00 00 0 0 3000 0 0 0 0 0\n",
     "3 1.000000000 1 012##1000000000000000000000000\n"},
    /* lines of tests of python-can 4.6.1, test_CanFd*.asc, logfile_vector_fd.asc and
     * test_CanErrorFrames.asc */
    {HEX "30.005021 CANFD   1 Rx        300                                   1 0 8  8 11 c2 03 04 "
         "05 06 07 08   102203  133   303000 e0006659 46500250 4b140250 20011736 2001040d\n"
         "30.005041 CANFD   2 Tx        1C4D80A7x                                   0 1 8  8 12 c2 "
         "03 04 05 06 07 08   102203  133   303000 e0006659 46500250 4b140250 20011736 2001040d\n"
         "30.005071 CANFD   3 Rx        30a  Generic_Name_12                  1 1 8  8 01 02 03 04 "
         "05 06 07 08   102203  133   303000 e0006659 46500250 4b140250 20011736 2001040d\n",
     "3 30.005021000 1 300##111C2030405060708\n4 30.005041000 2 1C4D80A7##212C2030405060708\n"
     "5 30.005071000 3 30A##30102030405060708\n"},
    {HEX "30.506898 CANFD   4 Rx        4EE                                   0 1 f 64 A1 02 "
         ZEROS_62 "64 1331984 11 0 46500250 460a0250 20011736 20010205\n"
         "31.506898 CANFD   4 Rx        1C4D80A7x    AlphaNumericName_2     1 0 f 64 b1 02 "
         ZEROS_62 "64 1331984 11 0 46500250 460a0250 20011736 20010205\n",
     "3 30.506898000 4 4EE##2A102" HEX_ZEROS_62 "\n"
     "4 31.506898000 4 1C4D80A7##1B102" HEX_ZEROS_62 "\n"},
    {HEX "30.300981 CANFD   3 Tx     50005x                                0 1 5 0 140000 73 "
         "200050 7a60 46500250 460a0250 20011736 20010205\n",
     "3 30.300981000 3 00050005#R5\n"},
    {HEX "30.806898 CANFD   5 Tx ErrorFrame Not Acknowledge error, dominant error flag fffe c7 "
         "31ca Arb. 556 44 0 0 f 64 " ZEROS_62 "1331984 11 0 46500250 460a0250\n",
     "3 30.806898000 5 error\n"},
    /* classical frames of CAN FD controllers, and lines that end early */
    {HEX "1.0 CANFD 1 Rx 123 0 0 2 2 AA BB 100000 50 220000 0 0 0 0 0\n"
         "1.1 CANFD 1 Rx 123 0 0 f 8 0 1 2 3 4 5 6 7 100000 50 0\n"
         "1.2 CANFD 1 Rx 123 1 0 2 2 AA BB\n1.3 CANFD 1 TxRq 123 1 0 2 2 AA BB\n"
         "1.4 CANFD 1 ErrorFrame\n",
     "3 1.000000000 1 123#AABB\n4 1.100000000 1 123#0001020304050607_F\n"
     "5 1.200000000 1 123##1AABB\n6 1.300000000 1 other\n7 1.400000000 1 error\n"},
    {DEC "1.0 CANFD 1 Rx 2047 1 0 9 12 255 0 0 0 0 0 0 0 0 0 0 16\n",
     "2 1.000000000 1 7FF##1FF0000000000000000000010\n"},
    {HEX "1.0 CAN 1 Status:chip status error active\n1.0 1 Statistic: D 0 R 0 XD 0\n"
         "1.1 SV: 3 0 1 ::Bla::MTimer = 0.000\n1.2 1 123 TxRq d 1 00\n1.3 Log trigger\n",
     "3 1.000000000  other\n4 1.000000000 1 other\n5 1.100000000  other\n6 1.200000000 1 other\n"
     "7 1.300000000  other\n"},
    /* bad ones */
    {"date Sat\n0.5 1 123 Rx d 0\n", "bad:2:1: 'base hex|dec timestamps absolute|relative' must "
                                     "come before the first event\n"},
    {"base oct timestamps absolute\n", "bad:1:6: expected 'hex' or 'dec'\n"},
    {"base hex timestamps often\n",
     "bad:1:10: expected 'timestamps absolute' or 'timestamps relative'\n"},
    {"base hex\n", "bad:1:9: expected 'timestamps absolute' or 'timestamps relative'\n"},
    {HEX "what is this\n", "bad:3:1: " ASC_LINE},
    {HEX "1 1 123 Rx d 0\n", "bad:3:1: expected a time in seconds such as 0.015991\n"},
    {HEX "1.0x 1 123 Rx d 0\n", "bad:3:1: expected a time in seconds such as 0.015991\n"},
    {HEX "1.0 1 Engine Rx d 0\n",
     "bad:3:7: 'Engine': expected an identifier in base hex, with x behind an extended one (names "
     "in place of identifiers are not understood)\n"},
    {HEX "1.0 1 800 Rx d 0\n", "bad:3:7: an identifier is at most 7FF, and 1FFFFFFFx (hex)\n"},
    {HEX "1.0 1 20000000x Rx d 0\n",
     "bad:3:7: an identifier is at most 7FF, and 1FFFFFFFx (hex)\n"},
    {HEX "1.0 1 123 Rx d\n", "bad:3:15: expected a data length code, 0 to 15 in the file's base\n"},
    {HEX "1.0 1 123 Rx d 10\n",
     "bad:3:16: expected a data length code, 0 to 15 in the file's base\n"},
    {HEX "1.0 1 123 Rx d 2 00\n", "bad:3:20: expected 2 data bytes in the file's base\n"},
    {HEX "1.0 1 123 Rx d 2 00 100\n", "bad:3:21: expected 2 data bytes in the file's base\n"},
    {DEC "1.0 1 123 Rx d 2 00 FF\n", "bad:2:21: expected 2 data bytes in the file's base\n"},
    {HEX "1.0 1 123 Rx d 1 00 11\n",
     "bad:3:21: more data bytes than the data length code says, 1\n"},
    {HEX "1.0 CANFD 1 Rx 800 1 0 0 0\n",
     "bad:3:16: an identifier is at most 7FF, and 1FFFFFFFx (hex)\n"},
    {HEX "1.0 CANFD 1 Rx 123 Name 2 0 0 0\n",
     "bad:3:25: expected BRS and ESI of a CAN FD frame, 0 or 1\n"},
    {HEX "1.0 CANFD 1 Rx 123 1 0 10 12\n",
     "bad:3:24: expected a data length code, 0 to 15 in the file's base\n"},
    {HEX "1.0 CANFD 1 Rx 123 1 0 f 65\n", "bad:3:26: expected a number of data bytes, 0 to 64\n"},
    {HEX "1.0 CANFD 1 Rx 123 1 0 2 2 00\n",
     "bad:3:30: expected 2 data bytes in the file's base\n"},
    {HEX "1.0 CANFD 1 Rx 123 1 0 9 9 0 0 0 0 0 0 0 0 0\n",
     "bad:3:45: 9 data bytes, but the data length code says 12\n"},
    {HEX "1.0 1 123 Rx r 10\n",
     "bad:3:16: expected a data length code, 0 to 15 in the file's base\n"},
};

TEST(lines_of_asc_are_read_or_refused)
{
    for (size_t i = 0; i < COUNT(asc); i++)
        assert_reads(asc[i].text, strlen(asc[i].text), TRACE_ASC, asc[i].expected);
}

/* ---- pcapng ---------------------------------------------------------------------------------- */

typedef struct capture {
    bool big;
    size_t size;
    unsigned char bytes[16384];
} capture;

static void put(capture *c, uint64_t value, unsigned bytes)
{
    for (unsigned i = 0; i < bytes; i++) {
        unsigned shift = 8 * (c->big ? bytes - 1 - i : i);
        c->bytes[c->size++] = (unsigned char)(value >> shift);
    }
}

/* Begins a block; end_block() puts in both lengths. */
static size_t begin_block(capture *c, uint32_t type)
{
    size_t start = c->size;
    put(c, type, 4);
    put(c, 0, 4);
    return start;
}

static void end_block(capture *c, size_t start)
{
    while ((c->size - start) % 4)
        put(c, 0, 1);
    uint32_t length = (uint32_t)(c->size - start + 4);
    size_t end = c->size;
    put(c, length, 4);
    memcpy(c->bytes + start + 4, c->bytes + end, 4);
}

static void put_section(capture *c, bool big)
{
    c->big = big;
    size_t start = begin_block(c, 0x0A0D0D0A);
    put(c, 0x1A2B3C4D, 4);
    put(c, 1, 2);
    put(c, 0, 2);
    put(c, UINT64_MAX, 8);
    end_block(c, start);
}

static void put_option(capture *c, unsigned code, const void *value, unsigned length)
{
    put(c, code, 2);
    put(c, length, 2);
    memcpy(c->bytes + c->size, value, length);
    c->size += length;
    while (c->size % 4)
        put(c, 0, 1);
}

static void put_interface(capture *c, unsigned link_type, const char *name, int resolution)
{
    size_t start = begin_block(c, 1);
    const uint8_t value = (uint8_t)resolution;
    put(c, link_type, 2);
    put(c, 0, 2);
    put(c, 0, 4);
    if (name)
        put_option(c, 2, name, (unsigned)strlen(name));
    if (resolution >= 0)
        put_option(c, 9, &value, 1);
    put_option(c, 0, "", 0);
    end_block(c, start);
}

static void put_packet(capture *c, uint32_t type, unsigned interface, uint64_t time,
                       const unsigned char *bytes, unsigned length)
{
    size_t start = begin_block(c, type);
    if (type == 2) {
        put(c, interface, 2);
        put(c, 0, 2);
    } else if (type == 6) {
        put(c, interface, 4);
    }
    if (type != 3) {
        put(c, time >> 32, 4);
        put(c, time & UINT32_MAX, 4);
        put(c, length, 4);
    }
    put(c, length, 4);
    memcpy(c->bytes + c->size, bytes, length);
    c->size += length;
    end_block(c, start);
}

static const unsigned char data_frame[] = {0, 0, 1, 0x23, 2, 0, 0, 0, 0xCA, 0xFE};
static const unsigned char long_frame[] = {0x92, 0x34, 0x56, 0x78, 8, 0, 0, 15,
                                           1,    2,    3,    4,    5, 6, 7, 8};
static const unsigned char remote_frame[] = {0x40, 0, 7, 0xFF, 5, 0, 0, 0};
static const unsigned char error_frame[] = {0x20, 0, 0, 4, 8, 0, 0, 0, 0, 4, 0, 0, 0, 0, 0, 0};
static const unsigned char fd_frame[] = {0, 0, 1, 0x23, 2, 4, 0, 0, 1, 2};
static const unsigned char bad_fd_id[] = {0, 0, 8, 0, 0, 4, 0, 0};
static const unsigned char bad_fd_length[] = {0, 0, 1, 0x23, 65, 4, 0, 0};
static const unsigned char cut_fd_frame[] = {0, 0, 1, 0x23, 12, 4, 0, 0, 0xCA};
static const unsigned char xl_frame[] = {0, 0, 1, 0x23, 0x80, 0, 0, 0, 1, 2, 3, 4, 5, 6};
static const unsigned char bad_id[] = {0, 0, 8, 0, 0, 0, 0, 0};
static const unsigned char bad_length[] = {0, 0, 1, 0x23, 9, 0, 0, 0};
static const unsigned char cut_frame[] = {0, 0, 1, 0x23, 2, 0, 0, 0, 0xCA};

#define FRAME(f) f, sizeof f

/* A section of each byte order, each with interfaces of its own and packets of all kinds. */
TEST(captures_are_read)
{
    capture c = {.size = 0};
    put_section(&c, false);
    put_interface(&c, 227, "can0", -1); /* microseconds */
    put_interface(&c, 227, NULL, 9);    /* nanoseconds */
    put_interface(&c, 1, "eth0", 6);
    put_packet(&c, 6, 0, 1500000, FRAME(data_frame));
    put_packet(&c, 6, 1, UINT64_C(5000000000), FRAME(long_frame));
    put_packet(&c, 6, 2, 2000000, FRAME(data_frame)); /* no CAN */
    put_packet(&c, 2, 0, 2500000, FRAME(remote_frame));
    put_packet(&c, 3, 0, 0, FRAME(data_frame));
    end_block(&c, begin_block(&c, 5));     /* statistics: nothing to replay */
    end_block(&c, begin_block(&c, 0xBAD)); /* unknown */
    size_t second = c.size;
    put_section(&c, true);
    put_interface(&c, 227, "vcan1", 0x80 | 10); /* 2^-10 s */
    put_packet(&c, 6, 0, 1024 + 512, FRAME(data_frame));
    put_packet(&c, 6, 0, 2048, FRAME(error_frame));
    put_packet(&c, 6, 0, 2048, FRAME(fd_frame));
    put_packet(&c, 6, 0, 2048, FRAME(xl_frame));
    assert_int_equal(second, 360);
    assert_reads(c.bytes, c.size, TRACE_DETECT,
                 "132 1.500000000 can0 123#CAFE\n176 5.000000000 1 12345678#0102030405060708_F\n"
                 "224 2.000000000 eth0 other\n268 2.500000000 can0 7FF#R5\n"
                 "308 - can0 123#CAFE\n348 -  other\n"
                 "432 1.500000000 vcan1 123#CAFE\n476 2.000000000 vcan1 error\n"
                 "524 2.000000000 vcan1 123##00102\n568 2.000000000 vcan1 xl\n");
}

/* Whole structs canfd_frame of the kernel, and frames that are as long as they have to be. */
static const unsigned char old_fd[72] = {0, 0, 1, 0x23, 2, 0, 0, 0, 1, 2, 3}; /* without FDF */
static const unsigned char flagged_fd[72] = {0x80, 0, 1, 0x23, 64, 7, 0, 0, [71] = 9};
static const unsigned char odd_fd[] = {0, 0, 1, 0x23, 9, 5, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9};
static const unsigned char empty_fd[] = {0, 0, 1, 0x23, 0, 6, 0, 0};

TEST(captures_of_fd_frames_are_read)
{
    capture c = {.size = 0};
    put_section(&c, false);
    put_interface(&c, 227, "a", 0);
    put_packet(&c, 6, 0, 1, FRAME(old_fd));
    put_packet(&c, 6, 0, 1, FRAME(flagged_fd));
    put_packet(&c, 6, 0, 1, FRAME(odd_fd));
    put_packet(&c, 6, 0, 1, FRAME(empty_fd));
    put_packet(&c, 6, 0, 1, FRAME(data_frame));
    assert_reads(c.bytes, c.size, TRACE_DETECT,
                 "68 1.000000000 a 123##00102\n"
                 "172 1.000000000 a 00000123##3" HEX_ZEROS_62 "0009\n"
                 "276 1.000000000 a 123##1010203040506070809000000\n"
                 "328 1.000000000 a 123##2\n368 1.000000000 a 123#CAFE\n");
}

typedef struct packet_case {
    const unsigned char *bytes;
    unsigned length;
    unsigned interface;
    uint64_t time;
    const char *expected;
} packet_case;

static const packet_case bad_packets[] = {
    {FRAME(bad_id), 0, 0, "bad: byte 68: the identifier 800 of a base frame is over 7FF\n"},
    {FRAME(bad_length), 0, 0, "bad: byte 68: a classical CAN frame with 9 data bytes\n"},
    {FRAME(cut_frame), 0, 0,
     "bad: byte 68: 9 bytes of a CAN frame of 10: cut off when it was captured\n"},
    {FRAME(bad_fd_id), 0, 0, "bad: byte 68: the identifier 800 of a base frame is over 7FF\n"},
    {FRAME(bad_fd_length), 0, 0, "bad: byte 68: a CAN FD frame with 65 data bytes\n"},
    {FRAME(cut_fd_frame), 0, 0,
     "bad: byte 68: 9 bytes of a CAN frame of 20: cut off when it was captured\n"},
    {data_frame, 7, 0, 0, "bad: byte 68: 7 bytes of a CAN frame: cut off when it was captured\n"},
    {FRAME(data_frame), 1, 0, "bad: byte 68: a packet of interface 1, which is not described\n"},
    {FRAME(data_frame), 0, UINT64_MAX, "bad: byte 68: the time of this packet is out of range\n"},
};

TEST(bad_packets_are_refused)
{
    for (size_t i = 0; i < COUNT(bad_packets); i++) {
        const packet_case *p = &bad_packets[i];
        capture c = {.size = 0};
        put_section(&c, true);
        put_interface(&c, 227, "can0", 0);
        put_packet(&c, 6, p->interface, p->time, p->bytes, p->length);
        assert_reads(c.bytes, c.size, TRACE_DETECT, p->expected);
    }
}

typedef struct damage {
    size_t at; /* byte that is changed ... */
    int value; /* ... to this, or -1: the file ends there */
    const char *expected;
} damage;

#define FOUND "68 1.000000000 can0 123#CAFE\n"

static const damage damages[] = {
    {8, 0,
     "0 damaged 28: a section without the byte order mark 1A2B3C4D\n" FOUND},
    {4, 30,
     "0 damaged 28: a block of 30 bytes: multiples of 4 from 12 to 16777216 are allowed\n" FOUND},
    {7, 8,
     "0 damaged 28: a block of 134217756 bytes: multiples of 4 from 12 to 16777216 are "
     "allowed\n" FOUND},
    {24, 0, "0 damaged 28: the two lengths of this block differ: 28 and 0\n" FOUND},
    {73, 1, "bad: byte 68: cut off: the file ends at byte 112\n"},
    {88, 250, "bad: byte 68: a packet that is longer than its block\n"},
    {6, -1, "bad: byte 0: this is neither pcapng nor pcap\n"},
    {20, -1, "bad: byte 0: cut off: the file ends at byte 20\n"},
    {74, -1, "bad: byte 68: cut off: the file ends at byte 74\n"},
    {76, -1, "bad: byte 68: cut off: the file ends at byte 76\n"},
    {96, -1, "bad: byte 68: cut off: the file ends at byte 96\n"},
    {100, -1, "bad: byte 68: cut off: the file ends at byte 100\n"},
    {107, -1, "bad: byte 68: cut off: the file ends at byte 107\n"},
    {108, -1, "bad: byte 68: cut off: the file ends at byte 108\n"},
    {110, -1, "bad: byte 68: cut off: the file ends at byte 110\n"},
};

TEST(damaged_captures_are_refused)
{
    for (size_t i = 0; i < COUNT(damages); i++) {
        const damage *d = &damages[i];
        capture c = {.size = 0};
        put_section(&c, false);
        put_interface(&c, 227, "can0", 0);
        put_packet(&c, 6, 0, 1, FRAME(data_frame));
        assert_int_equal(c.size, 112);
        if (d->value >= 0)
            c.bytes[d->at] = (unsigned char)d->value;
        assert_reads(c.bytes, d->value >= 0 ? c.size : d->at, TRACE_PCAPNG, d->expected);
    }
}

/* A block of each kind that has not even room for what stands in all of its kind. */
TEST(blocks_without_room_are_refused)
{
    static const struct {
        uint32_t type;
        unsigned bytes; /* of its body */
        const char *expected;
    } cases[] = {
        {1, 4, "bad: byte 60: an interface block that is too short\n"},
        {6, 16, "bad: byte 60: a packet block that is too short\n"},
        {2, 0, "bad: byte 60: a packet block that is too short\n"},
        {3, 0, "bad: byte 60: a packet block that is too short\n"},
    };
    for (size_t i = 0; i < COUNT(cases); i++) {
        capture c = {.size = 0};
        put_section(&c, i & 1);
        put_interface(&c, 227, NULL, 9);
        assert_int_equal(c.size, 60);
        size_t start = begin_block(&c, cases[i].type);
        for (unsigned k = 0; k < cases[i].bytes; k++)
            put(&c, 0, 1);
        end_block(&c, start);
        assert_reads(c.bytes, c.size, TRACE_DETECT, cases[i].expected);
    }
}

TEST(a_packet_needs_an_interface)
{
    capture c = {.size = 0};
    put_section(&c, false);
    put_packet(&c, 3, 0, 0, FRAME(data_frame));
    assert_reads(c.bytes, c.size, TRACE_DETECT,
                 "bad: byte 28: a packet before any interface is described\n");
}

TEST(interfaces_have_a_maximum)
{
    char expected[80];
    capture c = {.size = 0};
    put_section(&c, false);
    for (unsigned i = 0; i < TRACE_INTERFACES_MAX; i++)
        put_interface(&c, 227, NULL, -1);
    put_packet(&c, 6, TRACE_INTERFACES_MAX - 1, 0, FRAME(data_frame));
    assert_true(c.size < sizeof c.bytes / 2);
    snprintf(expected, sizeof expected, "%zu 0.000000000 %u 123#CAFE\n", c.size - 44,
             TRACE_INTERFACES_MAX - 1);
    assert_reads(c.bytes, c.size, TRACE_DETECT, expected);
    snprintf(expected, sizeof expected, "%zu 0.000000000 %u 123#CAFE\n%zu damaged 24: more than %u "
             "interfaces\n", c.size - 44, TRACE_INTERFACES_MAX - 1, c.size, TRACE_INTERFACES_MAX);
    put_interface(&c, 227, NULL, -1);
    assert_reads(c.bytes, c.size, TRACE_DETECT, expected);
}

/* Its header and packets, in either byte order and resolution. */
TEST(older_captures_are_read)
{
    for (unsigned i = 0; i < 4; i++) {
        capture c = {.big = i & 1};
        put(&c, i & 2 ? 0xA1B23C4D : 0xA1B2C3D4, 4);
        put(&c, 2, 2);
        put(&c, 4, 2);
        put(&c, 0, 8);
        put(&c, 65535, 4);
        put(&c, 227, 4);
        put(&c, 7, 4);
        put(&c, 250000, 4);
        put(&c, sizeof data_frame, 4);
        put(&c, sizeof data_frame, 4);
        memcpy(c.bytes + c.size, data_frame, sizeof data_frame);
        c.size += sizeof data_frame;
        assert_reads(c.bytes, c.size, TRACE_DETECT,
                     i & 2 ? "24 7.000250000 0 123#CAFE\n" : "24 7.250000000 0 123#CAFE\n");
        assert_reads(c.bytes, c.size - 1, TRACE_DETECT,
                     "bad: byte 24: cut off: the file ends at byte 49\n");
    }
}

/* ---- What a file is -------------------------------------------------------------------------- */

static const text_case unknown[] = {
    {"hello\n", "bad:1:1: this is neither a candump log, nor Vector ASC, nor pcapng (name it with "
                "'format' if it is)\n"},
    {"\n\n  can0  123  [0]\n", "3 - can0 123#\n"},
    {"  // a comment\nbase hex timestamps absolute\n", ""},
    {"DROPCOUNT: dropped 1 CAN frame on 'a' socket (total drops 1)\n", "1 -  other\n"},
    {"", ""},
};

TEST(the_format_is_found_out)
{
    for (size_t i = 0; i < COUNT(unknown); i++)
        assert_reads(unknown[i].text, strlen(unknown[i].text), TRACE_DETECT, unknown[i].expected);
}

/* ---- Replay ---------------------------------------------------------------------------------- */

#define BIT 160u

/* Returns "TICK FRAME" for each frame, and at last the messages. */
static char *replay_all(cfg_traffic *traffic, const char *content, uint64_t origin)
{
    char *text = NULL;
    size_t size;
    char problem[TRACE_PROBLEM_MAX];
    char note[REPLAY_NOTE_MAX];
    cw_frame frame;
    uint64_t tick;
    replay_step step;
    traffic->file = make_file(content, strlen(content));
    FILE *out = open_memstream(&text, &size);
    replay *r = replay_open(traffic, cw_rate_of(BIT), origin, problem);
    assert_true(out && r);
    while ((step = replay_next(r, &frame, &tick)) <= REPLAY_PAUSE) {
        char printed[FRAME_TEXT_MAX];
        text_print_frame(printed, &frame);
        if (step == REPLAY_FRAME)
            fprintf(out, "%" PRIu64 " %s\n", tick, printed);
    }
    if (step == REPLAY_FAILED)
        fprintf(out, "bad%s\n", replay_problem(r) + strlen(traffic->file));
    else if (replay_note(r, false, note))
        fprintf(out, "note%s\n", note + strlen(traffic->file));
    replay_close(r);
    fclose(out);
    unlink(traffic->file);
    free(traffic->file);
    return text;
}

typedef struct replay_case {
    cfg_traffic traffic;
    uint64_t origin;
    const char *content;
    const char *expected;
} replay_case;

#define TWO "(100.000000) can0 123#11\n(100.000100) can1 7FF#22\n"

static const replay_case replays[] = {
    {{.count = 1}, 0, TWO, "0 123#11\n8000 7FF#22\n"},
    {{.count = 1, .offset = {.ns = 1000}}, 5, TWO, "85 123#11\n8085 7FF#22\n"},
    /* begin and time are rounded together, up */
    {{.count = 1, .offset = {.ns = 7}},
     0,
     "(0.0) a 123#\n(0.000000005) a 123#\n",
     "1 123#\n1 123#\n"},
    {{.count = 2, .gap = {.bits = 1, .ns = 25}},
     0,
     TWO,
     "0 123#11\n8000 7FF#22\n8162 123#11\n16162 7FF#22\n"},
    {{.count = 1, .filters = {{.value = 0x7FF, .mask = 0x7FF}}, .filter_count = 1},
     0,
     TWO,
     "8000 7FF#22\n"}, /* its time is from the first entry of the file on */
    {{.count = 1, .channel = (char[]){"can0"}}, 0, TWO, "0 123#11\n"},
    {{.count = 3, .channel = (char[]){"can2"}}, 0, TWO,
     "note: no interface 'can2'; there is can0, can1\n"},
    {{.count = 1, .channel = (char[]){"can2"}}, 0, "", "note: no frame that is asked for\n"},
    {{.count = 1, .channel = (char[]){"x"}},
     0,
     "(1.0) 1 001#\n(1.0) 2 001#\n(1.0) 1 001#\n(1.0) 3 001#\n(1.0) 4 001#\n(1.0) 5 001#\n"
     "(1.0) 6 001#\n(1.0) 7 001#\n(1.0) 8 001#\n(1.0) 9 001#\n(1.0) 1 001#\n",
     "note: no interface 'x'; there is 1, 2, 3, 4, 5, 6, 7, 8 and more\n"},
    {{.count = 1,
      .channel = (char[]){"b"},
      .filters = {{.value = 1, .mask = 1}},
      .filter_count = 1},
     0,
     "(1.0) a 123#\n(1.0) b 124#\n",
     "note: no frame that is asked for\n"},
    {{.count = 1}, 0, "", "note: no frame\n"},
    {{.count = 2},
     0,
     "(1.0) a 20000004#0000000000000000\n(2.0) a 123#\n(2.0) a 123##0\n"
     "(2.0) a 124##0\n",
     "80000000 123#\n160000000 123#\nnote: left out: 1 error frame (line 1), 2 CAN FD frames (the "
     "first at line 3)\n"},
    {{.count = 1, .fd = true},
     0,
     "(1.0) a 123##112\n(2.0) a 00124#81:00:12345678#11\n(2.0) a 123#\n",
     "0 123##112\n80000000 123#\nnote: left out: 1 CAN XL frame (line 2)\n"},
    {{.count = 1, .fd = true, .filters = {{.value = 0x124, .mask = 0x7FF}}, .filter_count = 1},
     0,
     "(1.0) a 123##112\n(1.0) a 124##013\n",
     "0 124##013\n"},
    {{.count = 1, .channel = (char[]){"b"}}, 0, "(1.0) a 20000004#00\n(1.0) b 123#\n", "0 123#\n"},
    {{.count = 1},
     0,
     "(5.0) a 001#\n(4.0) a 002#\n(5.5) a 003#\n(5.2) a 004#\n",
     "0 001#\n0 002#\n40000000 003#\n40000000 004#\nnote: 2 entries that step back in time (the "
     "first at line 2), sent at once (if candump -t d made it, say 'format: candump-delta')\n"},
    {{.count = 1},
     0,
     "base hex timestamps absolute\n0.2 1 001 Rx d 0\n0.1 1 002 Rx d 0\n",
     "0 001#\n0 002#\nnote: 1 entry that steps back in time (line 3), sent at once (if its times "
     "are relative, its header needs 'timestamps relative')\n"},
    {{.count = 1, .format = TRACE_CANDUMP_DELTA},
     0,
     "(5.0) a 001#\n(0.5) a 002#\n(0.5) a 003#\n",
     "0 001#\n40000000 002#\n80000000 003#\n"},
    {{.count = 1}, 0, "(5.0) a 001#\n(x\n",
     "0 001#\nnote: left out: 1 damaged entry of 3 bytes (line 2: " CANDUMP_STAMP_TEXT ")\n"},
    {{.count = 1},
     0,
     "  a 001 [0]\n",
     "bad:1:3: there is no time stamp: record with candump -L or -t a, or replay with 'speed: "
     "max'\n"},
    {{.count = 2, .gap = {.ns = 1000}}, /* lines without their beginning and their end */
     0,
     "a 001 [0]\n(1.0) a 002#\n(1.1) a 003#1\n a 004#\n(1.1) a 005#00",
     "0 002#\n8000000 005#00\n8000080 002#\n16000080 005#00\nnote: left out: 1 damaged entry of "
     "14 bytes (line 3: '003#1': data bytes have two hexadecimal digits), 2 frames without a time "
     "(the first at line 1); 1 frame whose line has no end and may be cut (line 5)\n"},
    {{.count = 1, .fast = true}, 0, "  a 001 [0]\n  a 002 [0]\n", "0 001#\n0 002#\n"},
};

TEST(replays_are_at_their_times)
{
    for (size_t i = 0; i < COUNT(replays); i++) {
        cfg_traffic traffic = replays[i].traffic;
        FREED char *got = replay_all(&traffic, replays[i].content, replays[i].origin);
        assert_string_equal(got, replays[i].expected);
    }
}

/* A file that is searched in vain lets others have their turn. */
TEST(long_searches_pause)
{
    enum { LINES = 2500 };
    FREED char *content = NULL;
    size_t size;
    char problem[TRACE_PROBLEM_MAX];
    cw_frame frame;
    uint64_t tick;
    FILE *in = open_memstream(&content, &size);
    assert_non_null(in);
    for (unsigned i = 0; i < LINES; i++)
        fprintf(in, "(0.%06u) a 123#\n", i);
    fclose(in);
    cfg_traffic traffic = {.count = 1,
                           .filters = {{.value = 1, .mask = 0x7FF}},
                           .filter_count = 1,
                           .file = make_file(content, size)};
    replay *r = replay_open(&traffic, cw_rate_of(BIT), 0, problem);
    assert_int_equal(replay_next(r, &frame, &tick), REPLAY_PAUSE);
    assert_int_equal(tick, 999 * 80);
    assert_int_equal(replay_permille(r), 400);
    assert_int_equal(replay_next(r, &frame, &tick), REPLAY_PAUSE);
    assert_int_equal(tick, 1999 * 80);
    assert_int_equal(replay_next(r, &frame, &tick), REPLAY_OVER);
    replay_close(r);
    unlink(traffic.file);
    free(traffic.file);
}
