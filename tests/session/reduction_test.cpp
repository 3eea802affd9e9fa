#include "daemon/session/reduction.h"

#include <gmock/gmock.h>

#include "daemon/session/baselines.h"
#include "daemon/session/black_pixels.h"
#include "daemon/session/held_out.h"
#include "daemon/session/image_sites.h"
#include "sim/truth.h"
#include "tests/session/little_lab.h"
#include "tests/session/scratch.h"

namespace lightrig {
namespace {

using test::LittleLab;
using test::Recipe;

/// A material between those of the basis.
const Recipe unknown{{0.35, 0.22, 0.11}, 0.12, 0.22};
const std::vector<double> bracket{2e-4, 1.6e-3, 1.3e-2};

BrdfTable truth_table(const LittleLab& lab) {
  BrdfTable table = tabulate(unknown.reflectance(), BivariateGrid{}, 1);
  if (lab.rig.camera.sensor.channels() == 1) table.f = table.f.rowwise().mean().eval();
  return table;
}

Reduction reduce(LittleLab& lab, double ambient, bool ambient_frames, int threads) {
  ReductionOptions options;
  options.threads = threads;
  options.reference = Reference{"truth", truth_table(lab)};
  options.pictures = true;
  Reduction reduction(lab.rig, lab.spec, lab.prepared, lab.folder(), {}, options);
  const int shots = static_cast<int>(lab.prepared.plan.shots.size());
  for (int i = 0; i < shots; ++i) {
    const auto added =
        reduction.add(lab.capture(i, unknown.reflectance(), bracket, ambient, ambient_frames));
    EXPECT_TRUE(added) << added.error().message;
  }
  return reduction;
}

TEST(Reduction, BringsAKnownMaterialBackFromItsFrames) {
  const Scratch scratch;
  LittleLab lab(scratch.path());
  lab.plan({1, 4, 7, 11, 14, 16});
  Reduction reduction = reduce(lab, 0, false, 2);
  const CurvePoint point = reduction.estimate();
  EXPECT_EQ(point.lights, 5);
  EXPECT_EQ(point.elapsed_s, 50);
  const double zero_line = mean_only_error(reduction.basis(), truth_table(lab));
  EXPECT_LT(*point.true_error_percent, 5);
  EXPECT_LT(*point.true_error_percent, zero_line / 4);
  EXPECT_GT(*point.held_out_error_percent, 0);
  EXPECT_LT(*point.held_out_error_percent, *point.true_error_percent * 3);
}

// An ABORT's session is over when the light in hand is given up, not when it is reduced.
TEST(Reduction, GivesUpTheLightInHandWhenToldToStop) {
  const Scratch scratch;
  LittleLab lab(scratch.path());
  lab.plan({1, 7, 11, 16});
  std::stop_source stop;
  int beats = 0, last = 1000;
  ReductionOptions options;
  options.patience = {stop.get_token(), [&] {
                        if (++beats == last) stop.request_stop();
                      }};
  Reduction reduction(lab.rig, lab.spec, lab.prepared, lab.folder(), {}, options);
  ASSERT_TRUE(reduction.add(lab.capture(0, unknown.reflectance(), bracket)));
  reduction.estimate();
  EXPECT_FALSE(reduction.trouble());
  last = beats + 1;  // the next light's first frame
  const auto added = reduction.add(lab.capture(1, unknown.reflectance(), bracket));
  ASSERT_FALSE(added);
  EXPECT_EQ(added.error().code, ErrorCode::stopped);
  EXPECT_EQ(reduction.shots().size(), 1);
  EXPECT_EQ(beats, last) << "something was done after it";
  reduction.estimate();
  ASSERT_TRUE(reduction.trouble());
  EXPECT_EQ(reduction.trouble()->code, ErrorCode::stopped);
  EXPECT_EQ(beats, last);
}

TEST(Reduction, GivesEveryChannelOfAMosaicItsOwnValue) {
  const Scratch scratch;
  LittleLab lab(scratch.path(), ColorFilter::bayer_grbg);
  lab.plan({1, 4, 7, 11, 14, 16});
  Reduction reduction = reduce(lab, 0, false, 1);
  EXPECT_LT(*reduction.estimate().true_error_percent, 6);
  // Away from the highlight the material is 0.35 : 0.22 : 0.11.
  const BrdfTable& brdf = reduction.reconstruction().brdf;
  const int cell = brdf.grid.cell(60, 20);
  EXPECT_NEAR(brdf.f(cell, 0) / brdf.f(cell, 1), 0.35 / 0.22, 0.15);
  EXPECT_NEAR(brdf.f(cell, 1) / brdf.f(cell, 2), 0.22 / 0.11, 0.25);
}

TEST(Reduction, GivesTheSameNumbersWhateverTheNumberOfThreads) {
  const Scratch one_folder, three_folder;
  LittleLab one(one_folder.path()), three(three_folder.path());
  for (LittleLab* lab : {&one, &three}) lab->plan({1, 7, 11, 16});
  Reduction by_one = reduce(one, 0.3, true, 1), by_three = reduce(three, 0.3, true, 3);
  EXPECT_EQ(by_one.estimate().predicted_error_percent, by_three.estimate().predicted_error_percent);
  EXPECT_TRUE((by_one.coefficients().c.array() == by_three.coefficients().c.array()).all());
  for (std::size_t i = 0; i < by_one.shots().size(); ++i) {
    EXPECT_EQ(by_one.shots()[i].site_radiance, by_three.shots()[i].site_radiance);
  }
}

TEST(Reduction, TakesAmbientLightOutAgain) {
  const Scratch clean_folder, lit_folder, blind_folder;
  LittleLab clean(clean_folder.path()), lit(lit_folder.path()), blind(blind_folder.path());
  for (LittleLab* lab : {&clean, &lit, &blind}) lab->plan({1, 7, 11, 14, 16});
  const double ambient = 0.02;  // about the sample's own radiance in its dim parts
  const double without = *reduce(clean, 0, false, 2).estimate().true_error_percent;
  const double subtracted = *reduce(lit, ambient, true, 2).estimate().true_error_percent;
  const double ignored = *reduce(blind, ambient, false, 2).estimate().true_error_percent;
  EXPECT_LT(subtracted, 1.3 * without + 0.3);
  EXPECT_GT(ignored, 1.5 * subtracted);
}

// Its pixels are too noisy there to tell black from the darkest of the basis, and dark enough to
// tell that it is not this material, once the other pixels have told what that is. Half a picture
// of them, and two columns: even a few would bound f far below what it is.
TEST(Reduction, LeavesOutAShadowThatOnlyTheMaterialItselfTells) {
  double undisturbed = 0;
  for (const int shadow_to : {0, 120, 62}) {
    const Scratch scratch;
    LittleLab lab(scratch.path());
    lab.plan({1, 4, 7, 11, 14, 16});
    ReductionOptions options;
    options.reference = Reference{"truth", truth_table(lab)};
    Reduction reduction(lab.rig, lab.spec, lab.prepared, lab.folder(), {}, options);
    for (int i = 0; i < 5; ++i) {
      lab.shadow_from = 60;
      lab.shadow_to = i == 1 ? shadow_to : 0;
      ASSERT_TRUE(reduction.add(lab.capture(i, unknown.reflectance(), {2e-4, 2e-3})));
      EXPECT_EQ(reduction.observations().back().statistics.blocked, 0);
    }
    const double error = *reduction.estimate().true_error_percent;
    for (std::size_t i = 0; i < 5; ++i) {
      const std::int64_t blocked = reduction.observations()[i].statistics.blocked;
      if (i != 1 || shadow_to == 0)
        EXPECT_EQ(blocked, 0) << i;
      else
        EXPECT_GT(blocked, shadow_to == 120 ? 500 : 10);
    }
    EXPECT_EQ(error, *reduction.estimate().true_error_percent);
    if (shadow_to == 0)
      undisturbed = error;
    else
      EXPECT_LT(error, 1.5 * undisturbed) << shadow_to;
  }
}

// Darker than every material of the basis, with nothing before the lamp: black pixels are its own.
TEST(Reduction, BelievesTheBlackOfADarkMaterial) {
  const Recipe dark{{0.004, 0.004, 0.004}, 0.05, 0.2};
  const Scratch scratch;
  LittleLab lab(scratch.path());
  lab.plan({1, 4, 7, 11, 14, 16});
  Reduction reduction(lab.rig, lab.spec, lab.prepared, lab.folder(), {}, 1);
  std::int64_t black = 0;
  for (int i = 0; i < 5; ++i) {
    ASSERT_TRUE(reduction.add(lab.capture(i, dark.reflectance(), {2e-4, 2e-3})));
    for (const BlackSites& sites : reduction.observations().back().doubtful) black += sites.count;
  }
  EXPECT_GT(black, 500);
  const auto share = [&] {
    std::int64_t blocked = 0, sites = 0;
    for (const BrdfObservations& light : reduction.observations()) {
      blocked += light.statistics.blocked;
      sites += light.statistics.sites;
    }
    return static_cast<double>(blocked) / static_cast<double>(sites);
  };
  const double before = share();
  reduction.estimate();
  EXPECT_LT(share(), before + 0.01);
}

TEST(Reduction, RefusesAFrameThatIsNotTheOneTheJournalNames) {
  const Scratch scratch;
  LittleLab lab(scratch.path());
  lab.plan({7, 11});
  Reduction reduction(lab.rig, lab.spec, lab.prepared, lab.folder(), {}, 1);
  const CapturedShot shot = lab.capture(0, unknown.reflectance(), bracket);
  CapturedShot misstated = shot, swapped = shot;
  misstated.frames[1].exposure *= 2;
  std::swap(swapped.frames[0].file, swapped.frames[1].file);
  const auto foreign = reduction.add(swapped);
  ASSERT_FALSE(foreign);
  EXPECT_EQ(foreign.error().code, ErrorCode::invalid_input);
  EXPECT_THAT(foreign.error().message, testing::HasSubstr("not the bytes"));
  const auto added = reduction.add(misstated);
  ASSERT_FALSE(added);
  EXPECT_EQ(added.error().code, ErrorCode::invalid_input);
  EXPECT_THAT(added.error().message, testing::HasSubstr("the journal says"));
  EXPECT_TRUE(reduction.shots().empty());
}

TEST(Reduction, SaysWhichShotMissesAFrame) {
  const Scratch scratch;
  LittleLab lab(scratch.path());
  lab.plan({7, 11});
  Reduction reduction(lab.rig, lab.spec, lab.prepared, lab.folder(), {}, 2);
  CapturedShot shot = lab.capture(0, unknown.reflectance(), bracket);
  shot.frames[2].file = "frames/gone.exr";
  const auto added = reduction.add(shot);
  ASSERT_FALSE(added);
  EXPECT_EQ(added.error().code, ErrorCode::not_found);
  EXPECT_THAT(added.error().message,
              testing::AllOf(testing::HasSubstr("L01"), testing::HasSubstr("gone.exr")));
}

TEST(Reduction, KeepsFortyFiveComponentsForThePseudoInverse) {
  const Scratch scratch;
  LittleLab lab(scratch.path());
  lab.plan({7, 11});
  lab.spec.estimator = Estimator::pseudo_inverse;
  const Reduction reduction(lab.rig, lab.spec, lab.prepared, lab.folder(), {}, 1);
  EXPECT_EQ(reduction.basis().components(),
            std::min<Eigen::Index>(45, lab.prepared.fit_basis.components()));
}

TEST(Reduction, PicturesShowTheObjectAloneAndEveryColourOfIt) {
  const Scratch scratch;
  LittleLab lab(scratch.path(), ColorFilter::bayer_grbg);
  const CameraModel& camera = lab.rig.camera.model;
  const SurfacePoints all =
      points_of_pixels(lab.prepared.object.mesh, *lab.prepared.occluder, camera, 1);
  for (const int most : {40, 100, 1000}) {
    const ImageSites sites = image_sites(lab.prepared.object.mesh, *lab.prepared.occluder, camera,
                                         ColorFilter::bayer_grbg, most);
    EXPECT_LE(std::max(sites.width, sites.height), most + 1);
    EXPECT_EQ(sites.block % 2, 0);
    EXPECT_EQ(sites.stride % 2, 1);
    std::vector<int> seen(static_cast<std::size_t>(sites.width * sites.height), 0);
    for (const int site : all.source) {
      ASSERT_LT(sites.block_of(site), seen.size());
      ++seen[sites.block_of(site)];
    }
    const LinearImage image = block_image(sites, std::vector<float>(sites.points.source.size(), 1));
    int shown = 0;
    for (std::size_t i = 0; i < seen.size(); ++i) {
      const bool whole = seen[i] == sites.block * sites.block;
      if (whole) {
        EXPECT_TRUE((image.pixels[i] == 1).all()) << i;
      }
      if (seen[i] == 0) {
        EXPECT_TRUE(image.pixels[i].isNaN().all()) << i;
      }
      EXPECT_EQ(image.pixels[i].isNaN().any(), image.pixels[i].isNaN().all());
      if (whole) ++shown;
    }
    EXPECT_GT(shown, 0);
  }
}

TEST(Reduction, PredictsTheImageItCaptured) {
  const Scratch scratch;
  LittleLab lab(scratch.path());
  lab.plan({1, 4, 7, 11, 14, 16});
  Reduction reduction = reduce(lab, 0, false, 1);
  reduction.estimate();
  const BrdfLookup brdf(truth_table(lab));
  const ReducedShot& shot = reduction.shots()[2];
  const std::vector<float> predicted = predicted_radiance(
      *reduction.image_sites(0), brdf, shot.light, shot.strength, *lab.prepared.occluder, 2);
  double seen = 0, difference = 0;
  for (std::size_t i = 0; i < predicted.size(); ++i) {
    seen += static_cast<double>(std::abs(shot.site_radiance[i]));
    difference += static_cast<double>(std::abs(predicted[i] - shot.site_radiance[i]));
  }
  EXPECT_LT(difference / seen, 0.03);
}

// ln f̂ − ln f is 0.1 in every bin, ln f̂ is −2 everywhere, the posterior is as uncertain here as
// there: 100 · 0.1 / 2 = 5 %, by hand.
TEST(HeldOut, IsTheMisfitInTermsOfThePercentageError) {
  Reconstruction fit;
  fit.brdf.grid = {2, 2};
  fit.brdf.f = Eigen::ArrayXXd::Constant(4, 1, std::exp(-2.0));
  fit.log_stddev = Eigen::ArrayXXd::Constant(4, 1, 0.02);
  BrdfObservations light;
  for (const int cell : {0, 2}) {
    BrdfObservation row;
    row.cell = cell;
    row.f = std::exp(-2.1);
    light.rows.push_back(row);
  }
  const HeldOutError error = held_out_error({&light, 1}, fit, 1e-4);
  EXPECT_EQ(error.rows, 2);
  EXPECT_NEAR(error.seen_percent, 5, 1e-12);
  EXPECT_NEAR(error.percent, 5, 1e-12);

  // Half the table twice as uncertain: √((0.02² + 0.04²)/2)/0.02 = √2.5 times as much.
  fit.log_stddev(1, 0) = fit.log_stddev(3, 0) = 0.04;
  EXPECT_NEAR(held_out_error({&light, 1}, fit, 1e-4).percent, 5 * std::sqrt(2.5), 1e-12);

  // However overconfident the posterior is here, 2.5 times is all it may add.
  fit.log_stddev(1, 0) = fit.log_stddev(3, 0) = 4;
  EXPECT_NEAR(held_out_error({&light, 1}, fit, 1e-4).percent, 5 * 2.5, 1e-12);

  // Noise as large as the misfit explains all of it; what is left is the standard error of two
  // rows, 0.01 + 0.02² expected of each: 100 · √(0.0104 · √(2/2)) / 2.
  for (BrdfObservation& row : light.rows) row.variance = 0.01 * row.f * row.f;
  EXPECT_NEAR(held_out_error({&light, 1}, fit, 1e-4).seen_percent, 50 * std::sqrt(0.0104), 1e-9);
}

TEST(HeldOut, SaysNothingWithoutARow) {
  Reconstruction fit;
  fit.brdf.grid = {1, 1};
  fit.brdf.f = Eigen::ArrayXXd::Constant(1, 1, 0.1);
  fit.log_stddev = Eigen::ArrayXXd::Constant(1, 1, 0.1);
  EXPECT_TRUE(std::isnan(held_out_error({}, fit, 1e-4).percent));
}

// f = 0.05 ± one deviation of ln f of 0.12: with ln(f + 0.01) that is 0.12 · 0.05/0.06 = 0.1 of the
// mapped value, and three of them below it lies 0.06 · e^−0.3 − 0.01.
TEST(SurelyShown, TakesDeviationsInTheUnitsOfTheMapping) {
  Reconstruction fit;
  fit.brdf.grid = {1, 1};
  fit.brdf.f = Eigen::ArrayXXd::Constant(1, 1, 0.05);
  fit.log_stddev = Eigen::ArrayXXd::Constant(1, 1, 0.12);
  LogMapping mapping{Mapping::ln_offset, 0.01, {}, {}};
  const Eigen::ArrayXXd none = Eigen::ArrayXXd::Zero(1, 1);
  EXPECT_NEAR(surely_shown(fit, mapping, none)(0, 0), 0.06 * std::exp(-0.3) - 0.01, 1e-12);
  mapping.kind = Mapping::ln_floor;
  EXPECT_NEAR(surely_shown(fit, mapping, none)(0, 0), 0.05 * std::exp(-0.36), 1e-12);
}

TEST(RandomLights, ArePhotographedAndDependOnTheSeedAndNotOnTheThreads) {
  const Scratch scratch;
  LittleLab lab(scratch.path());
  for (const LightPosition& light : lab.candidates) {
    Candidate candidate;
    candidate.light = light;
    lab.prepared.candidates.push_back(candidate);
  }
  lab.rig.lamp.power = 1;
  lab.spec.bracket.exposures = {0.001, 0.008, 0.064};
  const BrdfTable truth = truth_table(lab);
  const Reflectance reflectance = sim::interpolated(to_merl(truth, 1));
  const auto run = [&](std::uint64_t seed, int threads) {
    return random_lights(lab.rig, lab.spec, lab.prepared, reflectance, truth,
                         {3, 2, seed, threads});
  };
  const RandomLights a = run(3, 1), b = run(3, 2), c = run(4, 2);
  EXPECT_EQ(a.map_percent, b.map_percent);
  EXPECT_EQ(a.pseudo_inverse_percent, b.pseudo_inverse_percent);
  EXPECT_NE(a.map_percent, c.map_percent);
  EXPECT_EQ(a.lights, 3);
  EXPECT_LT(a.map_percent, mean_only_error(lab.prepared.fit_basis, truth));
  // Noise is there: the same lights under exposures that hardly gather light come out otherwise.
  lab.spec.bracket.exposures = {1e-5};
  EXPECT_GT(run(3, 1).map_percent, a.map_percent);
}

}  // namespace
}  // namespace lightrig
