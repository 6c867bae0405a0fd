/* SPDX-License-Identifier: MIT
 *
 * orders.c - nodes whose controller is in a program: canwire-usb has one for the kernel's driver.
 *
 * Its orders change the node as `canwire set` and the link of an interface do, so
 * the journal has it.
 */
#include "engine/core.h"

/* Carries out what the program at a port asks for, such as `ip link set` of an emulated
 * interface. */
static void orders_obey(engine *e, unsigned node, const port_command *command)
{
    char problem[SETTINGS_ERROR_MAX];
    const message_order order = command->order;
    const bool good = engine_set_or_say(e, node, command->settings, problem);
    if (order == MESSAGE_OFF || (order == MESSAGE_ON && !good))
        engine_set_link(e, node, REPORT_LINK_DOWN);
    else if (order == MESSAGE_ON)
        engine_set_link(e, node, REPORT_LINK_UP);
    else if (order == MESSAGE_RESTART)
        (void)inputs_restart(&e->inputs, node); /* it may have left bus-off already */
    port_obeyed(e->now.ports[node], good ? NULL : problem);
}

void engine_obey(engine *e)
{
    for (unsigned i = 0; i < e->config->node_count; i++) {
        const port_command *command = port_next_command(e->now.ports[i]);
        if (command)
            orders_obey(e, i, command);
    }
}
