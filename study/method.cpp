#include "study/method.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <charconv>

namespace lightrig {
namespace {

using Lights = MethodSpec::Lights;
using Fit = MethodSpec::Fit;

const std::array<MethodSpec, 9>& named() {
  static const std::array<MethodSpec, 9> specs = {
      MethodSpec{"mean", Lights::none, false, Fit::mean, {}},
      MethodSpec{"bivariate", Lights::none, false, Fit::bivariate, {}},
      MethodSpec{"all-samples", Lights::none, false, Fit::all_samples, {}},
      MethodSpec{"random", Lights::random, false, Fit::pseudo_inverse, {}},
      MethodSpec{"random-map", Lights::random, false, Fit::map, {}},
      MethodSpec{"paper", Lights::condition, false, Fit::pseudo_inverse, {}},
      MethodSpec{"paper-map", Lights::condition, false, Fit::map, {}},
      MethodSpec{"pixels-map", Lights::condition, true, Fit::map, {}},
      MethodSpec{"a-optimal-map", Lights::a_optimal, true, Fit::map, {}}};
  return specs;
}

std::vector<std::string> parts_of(const std::string& name) {
  std::vector<std::string> parts;
  std::size_t begin = 0;
  while (true) {
    const std::size_t end = name.find(':', begin);
    parts.push_back(name.substr(begin, end - begin));
    if (end == std::string::npos) return parts;
    begin = end + 1;
  }
}

/// N of "key=N", at least `least`.
std::optional<int> setting(const std::string& part, const std::string& key, int least) {
  if (!part.starts_with(key + "=")) return std::nullopt;
  const char* begin = part.data() + key.size() + 1;
  const char* end = part.data() + part.size();
  int value = 0;
  const auto parsed = std::from_chars(begin, end, value);
  if (parsed.ec != std::errc() || parsed.ptr != end || value < least) return std::nullopt;
  return value;
}

tl::unexpected<Error> unknown(const std::string& name, const std::string& what) {
  std::vector<std::string> names;
  for (const MethodSpec& spec : named()) names.push_back(spec.name);
  return fail(
      ErrorCode::invalid_input,
      fmt::format("study: no method {}: {}; there are {}, and "
                  "condition|a-optimal|random:vertices|pixels:ESTIMATOR with :k=N, "
                  ":exposures=N and :range=bare if wanted, ESTIMATOR being pseudo-inverse, map, "
                  "map-stacked, map-ln-offset or map-log-relative",
                  name, what, fmt::join(names, ", ")));
}

}  // namespace

Result<MethodSpec> method_spec(const std::string& name) {
  for (const MethodSpec& spec : named()) {
    if (spec.name == name) return spec;
  }
  const std::vector<std::string> parts = parts_of(name);
  if (parts.size() < 3) return unknown(name, "no such name, and not of three parts");
  MethodSpec spec;
  spec.name = name;
  if (parts[0] == "condition") {
    spec.lights = Lights::condition;
  } else if (parts[0] == "a-optimal") {
    spec.lights = Lights::a_optimal;
  } else if (parts[0] == "random") {
    spec.lights = Lights::random;
  } else {
    return unknown(name, fmt::format("\"{}\" chooses no lights", parts[0]));
  }
  if (parts[1] != "vertices" && parts[1] != "pixels") {
    return unknown(name, fmt::format("\"{}\" is no kind of point", parts[1]));
  }
  spec.pixels = parts[1] == "pixels";
  constexpr std::array<const char*, 5> estimators = {"pseudo-inverse", "map", "map-stacked",
                                                     "map-ln-offset", "map-log-relative"};
  if (std::find(estimators.begin(), estimators.end(), parts[2]) == estimators.end()) {
    return unknown(name, fmt::format("\"{}\" is no estimator", parts[2]));
  }
  spec.fit = parts[2].starts_with("map") ? Fit::map : Fit::pseudo_inverse;
  if (parts[2].starts_with("map-")) spec.prior = parts[2].substr(4);
  for (std::size_t i = 3; i < parts.size(); ++i) {
    if (const std::optional<int> k = setting(parts[i], "k", 1)) {
      spec.components = *k;
    } else if (const std::optional<int> exposures = setting(parts[i], "exposures", 0)) {
      spec.exposures = *exposures;
    } else if (parts[i] == "range=bare") {
      spec.bare_range = true;
    } else {
      return unknown(name, fmt::format("\"{}\" sets nothing", parts[i]));
    }
  }
  return spec;
}

Result<std::vector<MethodSpec>> methods_of(const StudyOptions& o) {
  std::vector<std::string> names = o.methods;
  const bool axes = !o.criteria.empty() || !o.estimators.empty() || !o.component_counts.empty() ||
                    !o.exposure_counts.empty();
  if (names.empty() && !axes) {
    for (const MethodSpec& spec : named()) names.push_back(spec.name);
  }
  if (axes) {
    const auto or_else = [](std::vector<std::string> given, const char* usual) {
      return given.empty() ? std::vector<std::string>{usual} : given;
    };
    std::vector<std::string> k = {""}, exposures = {""};
    if (!o.component_counts.empty()) k.clear();
    for (const int n : o.component_counts) k.push_back(fmt::format(":k={}", n));
    if (!o.exposure_counts.empty()) exposures.clear();
    for (const int n : o.exposure_counts) exposures.push_back(fmt::format(":exposures={}", n));
    for (const std::string& criterion : or_else(o.criteria, "a-optimal")) {
      for (const std::string& estimator : or_else(o.estimators, "map")) {
        for (const std::string& some : k) {
          for (const std::string& bracket : exposures) {
            names.push_back(criterion + ":pixels:" + estimator + some + bracket);
          }
        }
      }
    }
  }
  std::vector<MethodSpec> out;
  for (const std::string& name : names) {
    Result<MethodSpec> spec = method_spec(name);
    if (!spec) return tl::unexpected(spec.error());
    const bool twice = std::any_of(out.begin(), out.end(),
                                   [&](const MethodSpec& there) { return there.name == name; });
    if (!twice) out.push_back(std::move(*spec));
  }
  return out;
}

std::span<const StudyMethod> study_methods() {
  static const std::array<StudyMethod, 9> methods = {
      StudyMethod{"mean", "the mean material, no light at all: the zero line"},
      StudyMethod{"bivariate",
                  "the bivariate approximation's own error, of materials that depend on φd"},
      StudyMethod{"all-samples", "the paper's basis fitted to every cell"},
      StudyMethod{"random", "random lights, vertices, pseudo-inverse"},
      StudyMethod{"random-map", "the same random lights, MAP"},
      StudyMethod{"paper", "least condition number over vertices, pseudo-inverse [Ali 2013]"},
      StudyMethod{"paper-map", "the paper's lights, MAP"},
      StudyMethod{"pixels-map", "least condition number over pixels, MAP"},
      StudyMethod{"a-optimal-map", "least expected error over pixels, MAP"}};
  return methods;
}

}  // namespace lightrig
