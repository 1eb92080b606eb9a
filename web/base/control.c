#include "web/base/control.h"

#include "web/web.h"

int web_tell(struct web *web, const Azulejo__Wire__Envelope *message)
{
    return web->is_connected && link_send(web->control, message, NULL) == STATUS_OK;
}

int web_is_connected(const struct web *web) { return web->is_connected; }

status web_store_usable(const struct web *web, struct error *err)
{
    if (!web->is_connected)
        return error_set(err, STATUS_ERR_IO, "the coordinator does not answer; try again in a moment");
    return web->state.store_why[0] ? error_set(err, STATUS_ERR_IO, "%s", web->state.store_why) : STATUS_OK;
}
