#include "daemon/session/report.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "daemon/session/chart.h"
#include "daemon/session/exposures_told.h"
#include "daemon/session/picture.h"
#include "daemon/session/report_text.h"
#include "daemon/session/session_story.h"

namespace lightrig {
namespace {

std::string card(const std::string& style, const std::string& name, const std::string& value,
                 const std::string& below) {
  return fmt::format("<div class=\"card {}\"><span>{}</span><b>{}</b><span>{}</span></div>\n",
                     style, escaped(name), escaped(value), escaped(below));
}

std::string image(const StoredPicture& picture, const std::string& alt, bool cells) {
  return fmt::format("<img{} width=\"{}\" alt=\"{}\" src=\"data:image/png;base64,{}\">",
                     cells ? " class=\"cells\"" : "", picture.width, escaped(alt),
                     base64(picture.png));
}

std::string legend(Eigen::Array3i (*colour)(double), double from, const std::string& low,
                   const std::string& middle, const std::string& high) {
  std::string stops;
  constexpr int steps = 10;
  for (int i = 0; i <= steps; ++i) {
    const Eigen::Array3i c = colour(from + (1 - from) * i / steps);
    stops += fmt::format(",rgb({} {} {})", c[0], c[1], c[2]);
  }
  return fmt::format(
      "<div class=\"legend\"><i style=\"background:linear-gradient(to right{})\"></i>"
      "<div><span>{}</span><span>{}</span><span>{}</span></div></div>",
      stops, escaped(low), escaped(middle), escaped(high));
}

// A (θh, θd) table with its axes named.
std::string grid_picture(const StoredPicture& picture, const std::string& alt) {
  return fmt::format(
      "<div class=\"grid-picture\"><div class=\"y\"><span>θd 0°</span><span>90°</span></div>{}"
      "<div class=\"x\"><span>θh 0°</span><span>highlight ← (√ scale) → grazing</span>"
      "<span>90°</span></div></div>",
      image(picture, alt, true));
}

double elapsed_of(const SessionResult& result) {
  return result.curve.empty() ? 0 : result.curve.back().elapsed_s;
}

double reduction_seconds(const SessionResult& result) {
  double sum = 0;
  for (const StageCost& stage : result.cost) sum += stage.seconds;
  return sum;
}

std::string headline(const SessionResult& r) {
  const Reconstruction& fit = r.reconstruction;
  std::string html = "<div class=\"cards\">\n";
  html += card("predicted", "Predicted error", percent(fit.predicted_error_percent),
               fmt::format("90 % interval {} to {}", percent(fit.predicted_low_percent),
                           percent(fit.predicted_high_percent)));
  if (r.held_out) {
    html +=
        card("held", "Held-out light", percent(r.held_out->percent),
             fmt::format("misfit at a light that was not fitted ({} over the {} bins it shows): a "
                         "check of pose and lamp, no estimate of the true error",
                         percent(r.held_out->seen_percent), counted(r.held_out->rows)));
  }
  if (r.true_error) {
    html += card("true", "True error", percent(r.true_error->percent_log),
                 fmt::format("against {}; linear, cosine-weighted {}", r.reference,
                             percent(r.true_error->percent_linear_cos)));
  }
  const auto fitted = std::count_if(r.lights.begin(), r.lights.end(),
                                    [](const LightResult& l) { return !l.shot.held_out; });
  html += card("cost", "Cost", spoken_duration(elapsed_of(r)),
               fmt::format("{} lights on the rig; computing {}", fitted,
                           spoken_duration(reduction_seconds(r))));
  return html + "</div>\n";
}

std::string compared_with(const SessionResult& r) {
  std::string text =
      fmt::format("The mean of the {} basis materials, without any light, is {} off{}.",
                  r.basis_materials, percent(r.baselines.mean_only_percent),
                  r.baselines.mean_only_is_true ? "" : " by prediction");
  if (const auto& random = r.baselines.random_lights) {
    text += fmt::format(
        " {} lights picked at random from the same reachable positions give {} with the published "
        "pseudo-inverse ({} components) and {} with the estimator used here (medians of {} sets, "
        "each light photographed by the simulated camera with noise and clipping).",
        random->lights, percent(random->pseudo_inverse_percent), random->components,
        percent(random->map_percent), random->sets);
  }
  return "<p>" + escaped(text) + "</p>\n";
}

std::string warnings(const SessionResult& r) {
  if (r.warnings.empty()) return "";
  std::string html = "<div class=\"warnings\"><h2>To know before using this result</h2><ul>\n";
  for (const std::string& line : r.warnings) html += "<li>" + escaped(line) + "</li>\n";
  return html + "</ul></div>\n";
}

std::string error_chart(const SessionResult& r) {
  const bool minutes = elapsed_of(r) > 180;
  const double unit = minutes ? 60 : 1;
  Chart chart{
      "Error against elapsed time",
      minutes ? "elapsed rig time [min]" : "elapsed rig time [s]",
      "percentage error (log scale)",
      {{"band", {}}},
      {{"predicted", "predicted", {}}, {"held-out light", "held", {}}, {"true", "true", {}}},
      {{"mean material alone", "mean", r.baselines.mean_only_percent}}};
  for (const CurvePoint& p : r.curve) {
    const double x = p.elapsed_s / unit;
    chart.bands[0].points.emplace_back(x, p.predicted_low_percent, p.predicted_high_percent);
    chart.lines[0].points.emplace_back(x, p.predicted_error_percent);
    if (p.held_out_error_percent) chart.lines[1].points.emplace_back(x, *p.held_out_error_percent);
    if (p.true_error_percent) chart.lines[2].points.emplace_back(x, *p.true_error_percent);
  }
  if (const auto& random = r.baselines.random_lights) {
    chart.levels.push_back({fmt::format("{} random, paper", random->lights), "random",
                            random->pseudo_inverse_percent});
    chart.levels.push_back(
        {fmt::format("{} random, MAP", random->lights), "random", random->map_percent});
  }
  return "<h2>Error against elapsed time</h2>\n<figure>" + to_svg(chart, 960, 400) +
         "<figcaption>One point per light, at the rig time by which it was stored. The band is the "
         "90 % interval of the prediction, calibrated on materials left out of the basis. The "
         "held-out light is calibrated on nothing: it shows what the fitted lights mostly showed "
         "too, and after several of them its misfit is mostly far below the true error. Where a "
         "light costs more time than the fall of the "
         "curve is worth, the session could have stopped.</figcaption></figure>\n";
}

std::string curve_table(const SessionResult& r) {
  std::string html =
      "<table><tr><th class=n>lights</th><th class=n>elapsed</th><th class=n>predicted</th>"
      "<th class=n>90 % interval</th><th class=n>held-out light</th><th class=n>true</th></tr>\n";
  for (const CurvePoint& p : r.curve) {
    html += fmt::format(
        "<tr><td class=n>{}</td><td class=n>{}</td><td class=n>{}</td><td class=n>{} – {}</td>"
        "<td class=n>{}</td><td class=n>{}</td></tr>\n",
        p.lights, spoken_duration(p.elapsed_s), percent(p.predicted_error_percent),
        percent(p.predicted_low_percent), percent(p.predicted_high_percent),
        p.held_out_error_percent ? percent(*p.held_out_error_percent) : "–",
        p.true_error_percent ? percent(*p.true_error_percent) : "–");
  }
  return html + "</table>\n";
}

std::string spheres(const ResultPictures& pictures) {
  if (!pictures.spheres.shown()) return "";
  const std::string names =
      pictures.with_reference
          ? "<div class=\"two-names\"><span>this result</span><span>reference</span></div>"
          : "";
  return fmt::format(
      "<h2>The material</h2>\n<figure style=\"width:max-content;max-width:100%\">{}{}</figure>\n"
      "<p class=note>A sphere of it in a studio (a warm disc, a cool window, a strip from behind), "
      "or "
      "in the light of the picture that <code>reduce --environment</code> was given{}.</p>\n",
      names, image(pictures.spheres, "sphere of the reconstructed material", false),
      pictures.with_reference ? "; both with the same brightness" : "");
}

std::string tables(const ResultPictures& p) {
  std::string html = "<h2>The (θh, θd) table</h2>\n<div class=\"row\">\n";
  const auto add = [&html](const std::string& title, const StoredPicture& picture,
                           const std::string& scale) {
    if (!picture.shown()) return;
    html += "<figure><h3>" + title + "</h3>" + grid_picture(picture, title) + scale + "</figure>\n";
  };
  add(p.with_reference ? "f, this result and reference" : "f", p.table,
      legend(sequential_colour, 0, fmt::format("{:.2g}", p.f_low), "1/sr, log scale",
             fmt::format("{:.2g}", p.f_high)));
  add("Difference from the reference", p.table_difference,
      legend(diverging_colour, -1, fmt::format("÷ {:.2g}", std::exp(p.table_difference_range)),
             "equal", fmt::format("× {:.2g}", std::exp(p.table_difference_range))));
  add("Uncertainty (one standard deviation)", p.uncertainty,
      legend(sequential_colour, 0, "0 %", "of f",
             fmt::format("{:.0f} %", 100 * std::expm1(p.uncertainty_high))));
  add("Lights that showed each cell", p.coverage,
      legend(sequential_colour, 0, "1", "", std::to_string(p.coverage_high)));
  return html +
         "</div>\n<p class=note>Left edge: the highlight. Top: light and camera far apart, towards "
         "grazing. Cells no light showed are blank in the last picture; their values come from the "
         "other materials' statistics, and their uncertainty says so. Blank cells of the first "
         "pictures have no value in any material.</p>\n";
}

std::string light_facts(const LightResult& light, bool by_condition) {
  const ExposuresTold exposures = exposures_told(light.shot);
  std::string skipped;
  for (const ExposuresTold::Skipped& one : exposures.skipped) {
    skipped += fmt::format("{}{}: {}", skipped.empty() ? "" : "; ", exposures_text({one.exposure}),
                           reason_of(one));
  }
  std::string html = fmt::format(
      "<h3>{}{}</h3><dl><dt>at</dt><dd>{:.3g}, {:.3g}, {:.3g}{}</dd><dt>stored "
      "after</dt><dd>{}</dd>"
      "<dt>exposures</dt><dd>{}</dd><dt>skipped</dt><dd>{}</dd>",
      escaped(light.shot.name), light.shot.held_out ? " · held out, not fitted" : "",
      light.light.p.x(), light.light.p.y(), light.light.p.z(),
      light.light.distant ? " (direction)" : " m", spoken_duration(light.shot.elapsed_s),
      exposures_text(exposures.used), skipped.empty() ? exposures_text({}) : skipped);
  html += fmt::format(
      "<dt>bins</dt><dd>{} measured, {} censored</dd><dt>new cells</dt><dd>{}</dd>"
      "<dt>misfit</dt><dd>{}</dd>",
      counted(light.rows_value), counted(light.rows_censored), counted(light.new_cells),
      percent(light.misfit_percent));
  if (!light.shot.held_out && light.planned && by_condition) {
    html += fmt::format("<dt>κ² planned</dt><dd>{}</dd>",
                        std::isfinite(light.condition) ? fmt::format("{:.3g}", light.condition)
                                                       : "∞ (rank still growing)");
  }
  return html + "</dl>";
}

std::string lights(const SessionResult& r, const ResultPictures& pictures) {
  std::string html = "<h2>Light by light</h2>\n";
  html +=
      legend(diverging_colour, -1, fmt::format("−{:.0f} %", 100 * pictures.image_difference_range),
             "difference", fmt::format("+{:.0f} %", 100 * pictures.image_difference_range));
  for (const LightResult& light : r.lights) {
    html += "<div class=\"light\"><div>" + light_facts(light, r.criterion == Criterion::condition) +
            "</div><div class=\"strip\">";
    const auto drawn =
        std::find_if(pictures.lights.begin(), pictures.lights.end(),
                     [&](const ResultPictures::Light& p) { return p.name == light.shot.name; });
    if (drawn != pictures.lights.end() && drawn->images.shown()) {
      html +=
          "<figure><div class=\"three\"><span>captured</span><span>re-rendered</span>"
          "<span>difference</span></div>" +
          image(drawn->images, drawn->name + ": captured, re-rendered, difference", false) +
          "</figure>";
    }
    if (drawn != pictures.lights.end() && drawn->bins.shown()) {
      html += "<figure><div class=\"three\"><span>cells</span></div>" +
              image(drawn->bins, drawn->name + ": cells shown", true) + "</figure>";
    }
    html += "</div></div>\n";
  }
  return html +
         "<p class=note>Captured and re-rendered share one tone curve. The difference is "
         "re-rendered "
         "against captured, per block of pixels; blank where nothing was measured. Cells: this "
         "light's part of the (θh, θd) table.</p>\n";
}

std::string left_out(const SessionResult& r) {
  std::string html =
      "<h2>What this scene did not need</h2>\n<table><tr><th>what</th><th class=n>left out</th>"
      "<th class=n>of</th><th>why</th></tr>\n";
  for (const LeftOutLine& line : r.left_out) {
    html += fmt::format(
        "<tr><td>{}</td><td class=n>{}</td><td class=n>{}</td><td class=why>{}</td></tr>\n",
        escaped(line.what), counted(line.left_out), line.of ? counted(*line.of) : "",
        escaped(line.why));
  }
  if (!r.drivers_not_opened.empty()) {
    html += fmt::format(
        "<tr><td>drivers not opened</td><td class=n>{}</td><td></td><td class=why>{}</td></tr>\n",
        r.drivers_not_opened.size(),
        escaped(fmt::format("{}", fmt::join(r.drivers_not_opened, ", "))));
  }
  return html + "</table>\n";
}

std::string cost(const SessionResult& r) {
  std::string html =
      "<h2>What it cost</h2>\n<table><tr><th>stage</th><th class=n>seconds</th></tr>\n";
  html +=
      fmt::format("<tr><td>on the rig, to the last light stored</td><td class=n>{:.1f}</td></tr>\n",
                  elapsed_of(r));
  for (const StageCost& stage : r.capture_cost)
    html += fmt::format("<tr><td>&emsp;{}</td><td class=n>{:.1f}</td></tr>\n", escaped(stage.stage),
                        stage.seconds);
  std::vector<StageCost> sums;
  for (const StageCost& stage : r.cost) {
    const auto same = std::find_if(sums.begin(), sums.end(),
                                   [&](const StageCost& s) { return s.stage == stage.stage; });
    if (same == sums.end()) {
      sums.push_back(stage);
    } else {
      same->seconds += stage.seconds;
    }
  }
  for (const StageCost& stage : sums) {
    html += fmt::format("<tr><td>{}</td><td class=n>{:.3f}</td></tr>\n", escaped(stage.stage),
                        stage.seconds);
  }
  return html + "</table>\n<p class=note>" + escaped(r.arithmetic) + "</p>\n";
}

std::string method(const SessionResult& r) {
  const auto row = [](const std::string& name, const std::string& value) {
    return "<dt>" + escaped(name) + "</dt><dd>" + escaped(value) + "</dd>";
  };
  std::string html = "<h2>How it was computed</h2>\n<div class=facts><dl>";
  html += row("object", r.object);
  html += row("basis", fmt::format("{}: {} materials, {} components ({:.2f} % of the variance)",
                                   r.basis_source, r.basis_materials, r.components,
                                   100 * r.variance_captured));
  html += row("mapping", fmt::format("{}, floor {:g} 1/sr", r.mapping, r.floor));
  html += row("estimator", fmt::format("{}, model σ {:.3g} (ln units; the basis expects {:.3g})",
                                       r.estimator, r.model_sigma, r.expected_sigma));
  html +=
      row("rows", fmt::format("{} measured, {} censored; residual {:.3g} rms (ln units)",
                              counted(r.coefficients.rows_value),
                              counted(r.coefficients.rows_censored), r.coefficients.residual_rms));
  html += row("planned by", describe(r.criterion) + "; stop: " + r.plan_stop);
  html += row("stopped by", r.stop_fired);
  html += row("scale", scale_in_words(r));
  html += row("white reference",
              !r.white.given() ? "none"
                               : fmt::format("{} of {}, ± {:.2g} %, sha256 {}", r.white.file,
                                             r.white.date, 100 * r.white.sigma, r.white.sha256));
  html +=
      row("lens", !r.lens.given() ? "as the rig file states it"
                                  : fmt::format("{} of {}, fx ± {:.2g} px, sha256 {}", r.lens.file,
                                                r.lens.date, r.lens.sigma, r.lens.sha256));
  return html +
         "</dl></div>\n<h3>The figures</h3>\n"
         "<p><b>Percentage error</b>: 100·‖ln f̂ − ln f‖ / ‖ln f‖ over all cells with a value and "
         "all "
         "channels, f in 1/sr, the floor applied to both. It depends on the unit; compare it only "
         "with the same measure. <b>Linear, cosine-weighted</b>: the same norm on f·cos θi·cos θo, "
         "dominated by the brightest cells.</p>\n"
         "<p><b>Predicted</b>: what the estimator expects of that figure from its own posterior, "
         "without knowing the truth. <b>Held-out light</b>: one light is captured and never "
         "fitted. "
         "Over the bins it shows, the root mean square of ln predicted − ln measured, less the "
         "sensor's noise, is set against the root mean square of ln f over the whole table; then "
         "scaled by how much more uncertain the posterior holds the whole table to be than those "
         "bins (by 2.5 at most). Far above the prediction, it says that pose, lamp or scale are "
         "not "
         "as the rig file has them; of directions that no light shows it says nothing. "
         "<b>Misfit</b>: the same "
         "before scaling, for each light.</p>\n";
}

}  // namespace

std::string report_html(const SessionResult& r, const ResultPictures& pictures) {
  const std::string title = r.sample_id.empty() ? r.session : r.sample_id;
  std::string html = fmt::format(
      "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">"
      "<title>{} – BRDF report</title><style>{}</style></head><body>\n",
      escaped(title), report_style());
  std::vector<std::string> about{"session " + r.session, "rig " + r.rig};
  if (!r.operator_name.empty()) about.push_back("operator " + r.operator_name);
  about.push_back(r.state);
  html += fmt::format("<h1>{}</h1>\n<p class=muted>{}</p>\n", escaped(title),
                      escaped(fmt::format("{}", fmt::join(about, " · "))));
  if (!r.notes.empty()) html += "<p>" + escaped(r.notes) + "</p>\n";
  html += headline(r) + compared_with(r) + warnings(r) + error_chart(r) + curve_table(r);
  html += spheres(pictures) + tables(pictures) + lights(r, pictures);
  html += left_out(r) + cost(r) + method(r);
  return html + "</body></html>\n";
}

}  // namespace lightrig
