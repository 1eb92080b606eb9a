#include "coordinator/web/routes.h"

#include "coordinator/web/assets.h"
#include "coordinator/web/health.h"

const struct web_route web_routes[] = {
    {WEB_GET, "/", WEB_ROLE_NONE, .run = web_asset_index, .summary = "The page."},
    {WEB_GET, "/assets/{file}", WEB_ROLE_NONE, .run = web_asset, .summary = "A file of the page."},
    {WEB_GET, "/healthz", WEB_ROLE_NONE, .run = web_healthz, .summary = "Say that the coordinator is alive."},
};
const size_t web_route_count = sizeof web_routes / sizeof *web_routes;

void web_route_run(struct web_request *request)
{
    request->route->run(request);
}
