/* SPDX-License-Identifier: MIT
 *
 * run_fit.h - warns of programs that the library of canwire run cannot reach.
 */
#ifndef CANWIRE_CLI_RUN_FIT_H
#define CANWIRE_CLI_RUN_FIT_H

/* Looks at a program, which execvp() will find, and prints a warning when the library is not for
 * it. Scripts and what cannot be read are left to execvp(). */
void run_warn_of(const char *program);

#endif
