/* SPDX-License-Identifier: MIT
 *
 * bench.h - the test bench. One stand-alone controller ("the node") faces scripts that play the
 * rest of the bus. They say, bit by bit, what the node drives and reports.
 *
 * A script is one elementary test: a new node that has seen 11 recessive bits, then tokens:
 *
 *     r d D X B   one bit (a number repeats it): what node and bench drive
 *                 r  both recessive              d  bench dominant, node recessive
 *                 D  node dominant only          B  both dominant
 *                 X  node dominant, but recessive is forced onto the bus
 *     (WORDS)     right after a bit: what the node reports in it (in the last one, if repeated)
 *                 TYPE POSITION ROLE FLAG   error: bit stuff form crc ack, tx|rx, act|pas|none;
 *                                           POSITION "here" is that of the bit of the frame
 *                 lostN ovl tol start tx rx drop exc   T+8 R-1 T=0 R=0   the counters move
 *                 at POSITION               where the node says that this bit stands
 *     <F          the bench sends frame F, the node receives, acknowledges and reports it
 *     >F          the node sends frame F (offered now, unless one is pending), the bench
 *                 acknowledges and the node reports it
 *     *F/G        the node sends F, the bench G with the higher priority: arbitration is lost
 *     -F          the bench sends F, the node takes no part in it at all
 *       @POS :POS after a frame: only from there, only up to before there (wire.h: POSITION)
 *     ~           the next bit of the frame inverted: on the bus when the node sends, else by
 *                 the bench
 *     N[ ... ]    repeats
 *     set=T,R     presets the counters       offer=F   offers F      refuse=F  ... must refuse
 *     withdraw    takes the offer back       restart   asks for it   overload=N  asks for them
 *     disconnect  cuts the node off          reconnect connects it again
 *     no-restart, no-withdraw          ... must be refused
 *     modes=M     changes modes, M of O (one-shot) L (listen-only) A (presume-ack)
 *                 B (loopback) R (restricted operation) T (time-triggered)
 *     init=M      as first token: a node that still integrates
 *     protocol=P  the node knows C (classical frames), T (they, and it tolerates FD frames) or F
 *                 (FD frames), and integrates again; with x it has no protocol exceptions, with n
 *                 it is non-ISO
 *     away        the node is gone: no closing check
 *
 *     +BIT        the bit only where frames are FD frames: the second one of the ACK slot
 *
 * All scripts run in several passes, with other frames or another node (passes). LETTERS: before a
 * script are the passes in which it runs, all by default.
 *
 * {a|b|c} makes a script of each alternative; several of them go in step. Nothing else may happen.
 * The level, the report, the counters, the state and, in frames, the place and the role are
 * compared in every bit. At the end the node must take part in one more frame. Counters move by
 * themselves in < and > at the bits that R7 and R8 name.
 */
#ifndef BENCH_H
#define BENCH_H

#include "wire.h"

#define SCRIPT_MAX 4096
#define WARNING_LIMIT 96u

/* Errors of the two roles to start from, and undisturbed error frames with intermission. */
#define F "123#55"
#define RX_ERROR "<" F ":crcdel d(form crcdel rx act R+1) "
#define RX_ERROR_PASSIVE "<" F ":crcdel d(form crcdel rx pas R+1) "
#define TX_ERROR ">" F ":crcdel d(form crcdel tx act T+8) "
#define TX_ERROR_PASSIVE ">" F ":crcdel d(form crcdel tx pas T+8) "
#define ACTIVE "D6 r8 r3 "
#define PASSIVE "r6 r8 r3 "
#define AGAIN ">" F " r3 "
#define SUSPEND "r8 "

/* The kind of frames and of the node, the same for all scripts of a run. */
typedef struct pass {
    char letter;        /* c classical frames; t, n the same at a node that is FD tolerant, or that
                           knows FD frames; f FD frames, l longer ones with BRS, o ones from
                           before ISO 11898-1:2015 (wire_format) */
    wire_format frames;
    unsigned protocol;  /* of the node; see cw_mac_set_protocol() */
} pass;

typedef struct test_case {
    const char *number;
    const char *script; /* NULL: run() makes them */
    void (*run)(void);
} test_case;

typedef struct section {
    const char *name;
    const test_case *cases;
    unsigned count;
} section;

extern const section section_7_1, section_7_2, section_7_3, section_7_4, section_7_5, section_7_6;
extern const section section_8_1, section_8_2, section_8_3, section_8_4, section_8_5, section_8_6;
extern const section section_7_7, section_7_8, section_8_7, section_8_8, section_9_6, section_x;
extern const section section_x_fd;

/* Runs the elementary tests of a case that has just been begun. */
void bench_run(const char *format, ...) __attribute__((format(printf, 1, 2)));

/* Runs frames of a format, 5 identifiers with each DLC, 0 to 8 of a classical frame. kind is < or
 * >. */
void bench_run_frames(char kind, bool extended);

/* Inverts every stuff bit of the frame that is no fixed one, one per elementary test; kind is < or
 * >. before begins the script. tail() gives what follows up to the repetition of the frame, the
 * expectation for the inverted bit first. */
void bench_run_stuff_bits(const char *before, char kind, const char *frame,
                          const char *(*tail)(const wire_bit *bit));

/* Does so with the fixed stuff bits of FD frames, each at both levels, with both lengths of the
 * CRC. */
void bench_run_fixed_stuff_bits(const char *before, char kind, const char *tail);

/* Counts an elementary test that was run without a script; why is NULL when it passed. */
void bench_count(const char *why);

/* Begins a case: results and messages go there, the random numbers start anew. */
void bench_begin(const char *number, unsigned *passed, unsigned *failed);

/* Chooses the pass for what follows. */
void bench_set_pass(const pass *p);

/* Returns the pass of a letter. */
const pass *bench_pass_of(char letter);

/* Returns the script behind its letters of passes, or NULL when this pass is none of them. */
const char *bench_in_pass(const char *script);

/* Makes a new node of the pass; part is its memory for FD frames. */
void bench_init_node(cw_mac *mac, cw_fd_part *part, unsigned modes);

/* Prints every script and bit that is played. */
void bench_set_verbose(bool verbose);

uint32_t bench_random(void);

/* Returns true when two frames have the same content. */
bool bench_same_frame(const cw_frame *a, const cw_frame *b);

/* ---- required.c: the cases that must be there, a table for each kind of node and frames ------ */

typedef struct requirement {
    const char *number;
    unsigned count; /* of elementary tests, in all passes of the table; at least */
} requirement;

typedef struct required_table {
    const char *title;  /* NULL: the first one */
    const char *passes; /* letters (pass) */
    const requirement *rows;
    size_t count;
} required_table;

extern const required_table required_tables[];
extern const unsigned required_table_count;

#endif
