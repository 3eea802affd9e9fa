// Materials, calibration and studies: what these verbs take.
#include "cli/verb_list.h"

#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace lightrig::cli {
namespace {

void add_target_options(CLI::App& verb, CalibrateOptions& options) {
  verb.add_option("--target", options.kind, "charuco or checkerboard")
      ->check(CLI::IsMember({"charuco", "checkerboard"}))
      ->capture_default_str();
  verb.add_option("--columns", options.columns, "Squares across")->required();
  verb.add_option("--rows", options.rows, "Squares down")->required();
  verb.add_option("--square-mm", options.square_mm, "Edge of a square, measured on the print")
      ->required()
      ->check(CLI::PositiveNumber);
  verb.add_option("--marker-mm", options.marker_mm, "Edge of a marker (ChArUco)");
}

void add_board_options(CLI::App& verb, CalibrateOptions& options) {
  CLI::Option* origin =
      verb.add_option(
              "--board-origin-m", options.board_origin,
              "Where the board's origin lay, in the rig's frame: the corner of the squares, "
              "at the print's upper left")
          ->expected(3);
  CLI::Option* columns = verb.add_option("--board-columns", options.board_columns,
                                         "Direction along the print's upper edge, rightwards")
                             ->expected(3);
  CLI::Option* rows = verb.add_option("--board-rows", options.board_rows,
                                      "Direction along its left edge, downwards")
                          ->expected(3);
  origin->needs(columns)->needs(rows);
  columns->needs(origin);
  rows->needs(origin);
  verb.add_option("--board-image", options.board_image,
                  "Picture in which it lay so; else the first in which it is found")
      ->needs(origin);
}

void add_material_verbs(Verbs& verbs) {
  auto name = std::make_shared<std::string>();
  auto directory = std::make_shared<std::string>();
  auto output = std::make_shared<std::string>();
  auto json = std::make_shared<bool>(false);
  auto chosen = std::make_shared<std::function<int()>>();
  CLI::App* verb = verbs.add("materials", "The built-in set, and materials of your own",
                             [chosen] { return (*chosen)(); });
  verb->require_subcommand(1);
  CLI::App* list = with_json(verb->add_subcommand("list", "The built-in set"), *json);
  list->callback([chosen, json] { *chosen = [json] { return materials_list(*json); }; });
  CLI::App* info =
      with_json(verb->add_subcommand("info", "One material, built in or a file"), *json);
  info->add_option("name", *name, "Name, or path of a MERL .binary file")->required();
  info->callback(
      [chosen, name, json] { *chosen = [name, json] { return materials_info(*name, *json); }; });
  CLI::App* importing =
      verb->add_subcommand("import", "Check a directory of MERL files, store tables");
  importing->add_option("directory", *directory, "Directory of .binary files")->required();
  importing->add_option("-o,--output", *output, "Directory to write")->required();
  importing->callback([chosen, directory, output] {
    *chosen = [directory, output] { return materials_import(*directory, *output); };
  });
}

void add_calibrate_verb(Verbs& verbs) {
  auto options = std::make_shared<CalibrateOptions>();
  auto chosen = std::make_shared<int (*)(const CalibrateOptions&)>(nullptr);
  CLI::App* verb = verbs.add("calibrate", "Calibration from images or from a session",
                             [options, chosen] { return (*chosen)(*options); });
  verb->require_subcommand(1);
  CLI::App* camera = with_json(
      verb->add_subcommand("camera", "Lens and pose from pictures of a target"), options->json);
  camera->add_option("images", options->images, "Pictures of the target")->required();
  add_target_options(*camera, *options);
  camera->add_option("-o,--output", options->output, "Calibration file to write")->required();
  add_board_options(*camera, *options);
  camera->callback([chosen] { *chosen = &calibrate_camera; });
  CLI::App* target = verb->add_subcommand("target", "The target as a picture to print");
  add_target_options(*target, *options);
  target->add_option("-o,--output", options->output, "PNG to write")->required();
  target->callback([chosen] { *chosen = &calibrate_target; });
  CLI::App* white =
      with_json(verb->add_subcommand("white", "Absolute scale from a session on a white target"),
                options->json);
  white->add_option("session", options->session, "Session folder")->required();
  white->add_option("--reflectance", options->reflectance, "Of the target: one number, or R G B")
      ->required()
      ->expected(1, 3);
  white->add_option("-o,--output", options->output, "White reference to write")->required();
  white->callback([chosen] { *chosen = &calibrate_white; });
}

void add_study_verb(Verbs& verbs) {
  auto options = std::make_shared<StudyVerbOptions>();
  auto shards = std::make_shared<std::vector<std::string>>();
  auto merging = std::make_shared<bool>(false);
  CLI::App* verb = verbs.add(
      "study", "Error against lights and run time, over many plans", [options, shards, merging] {
        return *merging ? study_merge(*shards, options->output) : study(*options);
      });
  verb->add_option("--objects", options->objects, "Shapes, mesh files, or names in --meshes");
  verb->add_option("--meshes", options->meshes, "Folder of named meshes");
  verb->add_option("--materials", options->materials, "builtin, or a directory of MERL files")
      ->capture_default_str();
  verb->add_option("--methods", options->methods,
                   "Methods to compare, by name or LIGHTS:POINTS:ESTIMATOR[:k=N][:exposures=N]"
                   "[:range=bare]; "
                   "all named ones where none is given");
  verb->add_option(
      "--criterion", options->criteria,
      "Axis: condition, a-optimal, random (over pixels; the axes' product is studied)");
  verb->add_option("--estimator", options->estimators,
                   "Axis: pseudo-inverse, map, map-stacked, map-ln-offset, map-log-relative");
  verb->add_option("--k", options->component_counts, "Axis: numbers of components");
  verb->add_option("--exposure-counts", options->exposure_counts,
                   "Axis: exposures of a bracket, as --exposures");
  verb->add_option("--rig", options->rig,
                   "Rig file whose motion model predicts capture times; 12 s a light without");
  verb->add_option("--lights", options->lights, "Numbers of lights to report");
  verb->add_option("--splits", options->splits, "Splits into training and test")
      ->capture_default_str();
  verb->add_option("--random-runs", options->random_runs, "Random light sets per split")
      ->capture_default_str();
  verb->add_option("--candidates", options->candidates, "Candidate lights")->capture_default_str();
  verb->add_option("--components", options->components, "Components of the paper's basis")
      ->capture_default_str();
  verb->add_option("--exposures", options->exposures, "Exposures of a bracket; 0: no clipping")
      ->capture_default_str();
  verb->add_flag("--around-median", options->around_median,
                 "Brackets lie about the median row, not where they clip fewest");
  verb->add_option("--noise", options->noise, "Relative noise of a measured row");
  verb->add_option("--floor", options->floor, "Floor of the logarithm [1/sr]")
      ->capture_default_str();
  verb->add_option("--seed", options->seed, "Of splits and random lights")->capture_default_str();
  add_threads(verb, options->threads);
  verb->add_option("--shard", options->shard, "Do the i-th of n parts: i/n");
  verb->add_flag("--table1", options->table1, "The paper's Table 1 beside ours");
  verb->add_option("-o,--output", options->output, "Folder to write");
  CLI::App* merge = verb->add_subcommand("merge", "Bring the folders of shards together");
  merge->add_option("shards", *shards, "Folders of the shards")->required();
  merge->add_option("-o,--output", options->output, "Folder to write")->required();
  merge->callback([merging] { *merging = true; });
}

}  // namespace

void add_library_verbs(Verbs& verbs) {
  add_material_verbs(verbs);
  add_calibrate_verb(verbs);
  add_study_verb(verbs);
}

}  // namespace lightrig::cli
