/* SPDX-License-Identifier: MIT
 *
 * xmltext.h - text in XML and HTML.
 */
#ifndef CANWIRE_BASE_XMLTEXT_H
#define CANWIRE_BASE_XMLTEXT_H

#include <stdio.h>

/* Writes a text so that it means itself. Characters that XML does not allow become '?'. */
void xml_text(FILE *out, const char *text);

/* Does the same in the value of an attribute, where ends of lines and tabs become '?', too. */
void xml_value(FILE *out, const char *text);

/* Writes a space and NAME="VALUE". */
void xml_attribute(FILE *out, const char *name, const char *value);

#endif
