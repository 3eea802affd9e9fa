// snap: a frame for the preview, and the model drawn over it.
#include <fmt/format.h>

#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include "cli/json_fields.h"
#include "cli/overlay_words.h"
#include "cli/rig_files.h"
#include "cli/say.h"
#include "cli/service_client.h"
#include "cli/verbs.h"
#include "config/json_text.h"
#include "daemon/session/durable_file.h"
#include "daemon/session/pose_overlay.h"
#include "daemon/session/session_folder.h"

namespace lightrig::cli {
namespace {

/// Where the service says that the gantry stands; empty where it does not know.
Result<std::optional<GantryPosition>> gantry_position(const ServiceClient& client, const Rig& rig) {
  const auto status = client.get_json("/v1/status");
  if (!status) return tl::unexpected(status.error());
  const Json at = part(part(part(*status, "devices"), "gantry"), "position");
  if (at.size() != rig.gantry.model.axes.size()) return std::optional<GantryPosition>();
  GantryPosition position;
  position.axes.resize(static_cast<Eigen::Index>(at.size()));
  for (std::size_t i = 0; i < at.size(); ++i) {
    if (!at[i].is_number()) return std::optional<GantryPosition>();
    position.axes[static_cast<Eigen::Index>(i)] = at[i].get<double>();
  }
  return std::optional<GantryPosition>(position);
}

}  // namespace

int snap(const SnapOptions& options) {
  const ServiceClient client(options.service);
  if (options.exposure > 0) {
    const auto reply = client.post(
        "/v1/snap",
        {{"exposure_s", options.exposure}, {"lamp", options.lamp}, {"key", request_key()}});
    if (!reply) return complain(reply.error());
    if (auto end = client.wait_for(reply->value("command", std::uint64_t{0})); !end)
      return complain(end.error());
  }
  const auto png = client.get("/v1/preview");
  if (!png) return complain(png.error());
  if (!options.overlay) {
    if (auto written = write_durably(options.output, *png); !written)
      return complain(written.error());
    say(options.service.json
            ? json_text(Json{{"ok", true}, {"file", options.output}})
            : (options.exposure > 0 ? "frame written to " : "last frame written to ") +
                  options.output);
    return 0;
  }
  if (options.rig.empty())
    return complain("--overlay draws what the rig file models over the frame: name it with --rig");
  const RigFiles files = read_rig_files(options.rig, options.session);
  show_diagnostics(files);
  if (!files.valid()) return 1;
  const auto prepared = prepare(*files.rig.value, files.spec());
  if (!prepared) return complain(with_context("plan", prepared.error()));
  const Rig& rig = *files.rig.value;
  const auto at = gantry_position(client, rig);
  if (!at) return complain(at.error());
  const GantryPosition stands = at->value_or(home_position(rig.gantry.model));
  const auto drawn = overlay_png(*png, rig, *prepared, stands);
  if (!drawn) return complain(drawn.error());
  if (auto written = write_durably(options.output, *drawn); !written)
    return complain(written.error());
  const ExpectedHighlights highlights = expected_highlights(rig, *prepared, stands);
  std::vector<std::vector<std::string>> rows;
  for (const ExpectedHighlight& one : highlights.seen)
    rows.push_back({shot_name(prepared->plan, one.shot),
                    fmt::format("{:.0f}, {:.0f}", one.pixel.x(), one.pixel.y()),
                    fmt::format("{:.1f}°", one.off * 180 / std::numbers::pi)});
  const PoseSaid pose = pose_said(*png, rig, *prepared, *at, options.exposure > 0 && options.lamp);
  if (options.service.json) {
    say(json_text(
        overlay_json(options.output, prepared->plan, highlights, pose, !at->has_value())));
    return 0;
  }
  std::string words =
      table({"light", "highlight at column, row", "from the mirror direction"}, rows) +
      not_drawn_words(prepared->plan, highlights);
  if (!*at) words += "the gantry's position is not known: drawn as at home\n";
  say(words + pose.words +
      "\nlast frame with the model's outline (green) and highlights (rings) written to " +
      options.output);
  return 0;
}

}  // namespace lightrig::cli
