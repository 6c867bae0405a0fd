/* SPDX-License-Identifier: MIT
 *
 * kept.h - remembers injected rules beyond the end of the process.
 *
 * The next start injects those again that are to be kept. Of the others it says which a crash has
 * lost.
 *
 * The file is PATH.rules beside the control socket at PATH, and is replaced as a whole. So a crash
 * leaves either the old or the new one. Its time is that of the last second in which the process
 * lived.
 */
#ifndef CANWIRE_SERVE_KEPT_H
#define CANWIRE_SERVE_KEPT_H

#include "run/inputs.h"

#include <jansson.h>
#include <stddef.h>

#define KEPT_NOTE_BYTES 300

typedef struct kept kept;

/* Reads the file that belongs to a control socket, and logs the rules that a crash has lost. bus is
 * the name of the bus. A damaged file is moved away. Returns NULL after logging why, without memory
 * or the folder. */
kept *kept_open(const char *control, const char *bus);

/* Injects the rules that are kept, after a start or a reload: the bus has no injected rules then.
 * It logs those that the bus refuses; they stay for another configuration. */
void kept_apply(kept *k, inputs *in);

/* Notes that rules have been injected with a text; keep: they are to be kept. Returns false,
 * with an errno, when rules to be kept cannot be written; they are not noted then. */
bool kept_note(kept *k, const json_t *text, const char *name, const json_t *rules, bool keep);

/* Notes that a rule has been cleared. Returns false for one that it does not know. */
bool kept_clear(kept *k, const char *rule);

/* Notes that all injected rules have been cleared, also those that the bus has refused. */
void kept_clear_all(kept *k);

/* Writes the file after kept_clear(). It logs when that fails. */
void kept_save(kept *k);

/* Says in the time of the file that the process lives; call it about once a second. */
void kept_live(kept *k);

/* Returns "2 injected rules were lost with the crash at T: a, b", or "". It is of use until rules
 * are injected or cleared. */
const char *kept_lost(const kept *k);

/* Puts `kept_rules` and `lost_rules` of config/control.md. */
void kept_put(const kept *k, json_t *status);

/* Ends without a crash. NULL is allowed. */
void kept_close(kept *k);

#endif
