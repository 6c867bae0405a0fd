/* SPDX-License-Identifier: MIT
 *
 * kept.h - remembers injected rules beyond the end of the process, and that it has judged.
 *
 * The next start injects those again that are to be kept. Of the others it says which a crash has
 * lost, and how many verdicts.
 *
 * The file is PATH.rules beside the control socket at PATH, and is replaced as a whole. So a crash
 * leaves either the old or the new one. Its time is that of the last second in which the process
 * lived.
 */
#ifndef CANWIRE_SERVE_KEPT_H
#define CANWIRE_SERVE_KEPT_H

#include "run/inputs.h"

#include <ev.h>
#include <jansson.h>
#include <stddef.h>
#include <stdint.h>

#define KEPT_NOTE_BYTES 300
#define KEPT_BYTES_MAX (1u << 20) /* of all kept texts: each save prints them in the loop */

typedef struct kept kept;

/* Reports that all saves up to this number are in the file, or the errno with which they are not,
 * for spool_explain(). That has been logged. */
typedef void kept_written(void *user, uint64_t save, int error);

/* Reads the file that belongs to a control socket, and logs the rules that a crash has lost. bus is
 * the name of the bus. A damaged file is moved away. Each save is reported in the loop. Returns
 * NULL after logging why, without memory or the folder. */
kept *kept_open(struct ev_loop *loop, const char *control, const char *bus, kept_written *told,
                void *user);

/* Injects the rules that are kept, after a start or a reload: the bus has no injected rules then.
 * It logs those that the bus refuses; they stay for another configuration. */
void kept_apply(kept *k, inputs *in);

/* Notes that rules have been injected with a text; keep: they are to be kept. Then what is known of
 * losses is forgotten when they are in the file. Returns the number of the save, see
 * kept_save(). */
uint64_t kept_note(kept *k, const json_t *text, const char *name, const json_t *rules, bool keep);

/* Notes that a rule has been cleared. Returns false for one that it does not know. */
bool kept_clear(kept *k, const char *rule);

/* Takes a rule out of what is remembered, since it could not be saved. */
bool kept_take_back(kept *k, const char *rule);

/* Returns the number, from 1, of the text that a rule of the bus is kept with; 0: with none. */
size_t kept_find(const kept *k, const char *rule);

/* Returns the length of all texts that are kept. */
size_t kept_bytes(const kept *k);

/* Notes that all injected rules have been cleared. Adds the names of those that the bus has refused
 * to a list. */
void kept_clear_all(kept *k, json_t *refused);

/* Lets a thread write the file, as after kept_clear(). Returns the number of the save, of which
 * kept_written() tells; 0 when no file is needed or there, or after logging why it cannot
 * begin. */
uint64_t kept_save(kept *k);

/* Numbers of expectations: those that are judged, and those of them that have failed. */
typedef struct kept_tally {
    uint64_t expectations;
    uint64_t failed;
} kept_tally;

/* Notes how the verdicts stand: a crash would lose them. It may be called again and again. */
void kept_judges(kept *k, kept_tally now);

/* Says in the time of the file that the process lives; call it about once a second. */
void kept_live(kept *k);

/* Returns "2 injected rules were lost with the crash at T: a, b", or "". It also has the file that
 * was of no use, and the texts that the bus refuses. It is there up to the next call. The first two
 * stay, also over further crashes, until rules are injected or cleared or canwired is stopped. It
 * has lost verdicts, too, until canwired is stopped. */
const char *kept_trouble(kept *k);

/* Puts `kept_rules`, `lost_rules`, `unread_rules` and `lost_verdicts` of canwire-control(7). */
void kept_put(const kept *k, json_t *status);

/* Ends without a crash. NULL is allowed. */
void kept_close(kept *k);

#endif
