/* SPDX-License-Identifier: MIT
 *
 * typetext.h - parts of what tables of keys say for JSON schema (daemon/schema/type.h).
 */
#ifndef CANWIRE_BASE_TYPETEXT_H
#define CANWIRE_BASE_TYPETEXT_H

#define TYPE_REF(name) "{'$ref': '#/$defs/" name "'}"
#define TYPE_ANY(types) "{'anyOf': [" types "]}"
#define TYPE_LIST(min, max, item)                                                                  \
    "{'type': 'array', 'minItems': " #min ", 'maxItems': " #max ", 'items': " item "}"
#define TYPE_LIST_UP_TO(max, item) "{'type': 'array', 'maxItems': " #max ", 'items': " item "}"
#define TYPE_SET(max, item)                                                                        \
    "{'type': 'array', 'minItems': 1, 'maxItems': " #max ", 'uniqueItems': true, 'items': " item "}"
/* One value, or a list of them. */
#define TYPE_SOME(max, item) TYPE_ANY(item ", " TYPE_LIST(1, max, item))
/* A value, or a parameter that stands for it; for items of rules. */
#define TYPE_OPEN(type) TYPE_ANY(type ", " TYPE_REF("parameter"))
/* A text that may look like a number. */
#define TYPE_TEXT(pattern) "{'type': ['string', 'number'], 'pattern': '" pattern "'}"
#define TYPE_INTEGER(min, max) "{'type': 'integer', 'minimum': " #min ", 'maximum': " #max "}"

#define TYPE_STRING "{'type': 'string', 'minLength': 1}"
/* As schema_read_uint() and schema_read_choice() have it, for readers that call them. */
#define TYPE_UINT "uint"
#define TYPE_CHOICE "choice"

/* Rules of maps. */
#define TYPE_NEEDS(key) "{'required': ['" key "']}"
#define TYPE_IF(condition, then) "{'if': " condition ", 'then': " then "}"

#endif
