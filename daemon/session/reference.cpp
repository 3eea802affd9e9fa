#include <fmt/format.h>

#include "core/brdf_table.h"
#include "daemon/session/compare.h"
#include "daemon/session/reduction.h"
#include "sim/open_devices.h"

namespace lightrig {
namespace {

// φd values over which a continuous truth is averaged into a cell: MERL's own number.
constexpr int azimuths = 180;

}  // namespace

Result<std::optional<Reference>> reference_of(const Rig& rig, const SessionSpec& spec,
                                              bool simulated) {
  Reference reference;
  if (!spec.reference.empty()) {
    auto table = load_brdf(spec.reference);
    if (!table) return tl::unexpected(with_context("read the reference", table.error()));
    // A hidden file is what the service and `lightrig simulate` write beside the sessions.
    const std::string name = spec.reference.stem().string();
    reference = {name == ".simulated-truth" ? "the simulated truth" : name, std::move(*table),
                 false};
  } else if (simulated && rig.simulation) {
    const auto truth = sim::truth_of(rig);
    if (!truth) return tl::unexpected(with_context("find the simulated truth", truth.error()));
    reference.name =
        std::filesystem::path(rig.simulation->material).stem().string() + " (simulated truth)";
    reference.simulated = true;
    reference.table = tabulate(*truth, BivariateGrid{}, azimuths);
  } else {
    return std::nullopt;
  }
  if (rig.camera.sensor.channels() == 1 && reference.table.f.cols() > 1) {
    reference.table.f = reference.table.f.rowwise().mean().eval();
  }
  return reference;
}

}  // namespace lightrig
