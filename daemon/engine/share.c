/* SPDX-License-Identifier: MIT
 *
 * share.c - tells a port how programs share it.
 */
#include "engine/share.h"

void share_port(port *p, const cfg *config, unsigned node)
{
    _Static_assert(CFG_CLIENTS_MAX == PORT_CLIENTS_MAX, "");
    const cfg_node *n = &config->nodes[node];
    if (!p)
        return;
    const port_sharing sharing = {
        .node = n->name,
        .fd = cfg_knows_fd(config, n),
        .max = n->clients.max,
        .echo = n->clients.echo == CFG_ECHO_SENT ? PORT_ECHO_SENT : PORT_ECHO_AT_ONCE,
        .beacon = n->clients.beacon,
    };
    port_share(p, &sharing);
}
