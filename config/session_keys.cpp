#include "config/descriptions.h"

namespace lightrig {
namespace {

TableSpec object_table() {
  const Condition built_in{"shape", {}}, file{"mesh", {}};
  TableSpec t{.name = "object",
              .doc = "The object in front of the camera: a mesh file or a built-in shape."};
  t.keys = {
      {.name = "mesh",
       .kind = ValueKind::path,
       .need = Need::optional,
       .doc = "Mesh file: PLY, OBJ or STL."},
      {.name = "shape",
       .kind = ValueKind::choice,
       .need = Need::optional,
       .choices = {"sphere", "plane", "cylinder", "torus", "teapot"},
       .doc = "Built-in shape."},
      {.name = "unit_m",
       .unit = units::m,
       .range = {0, 1e6, true},
       .when = file,
       .doc = "Metres per unit of the mesh file: 1 for metres, 0.001 for millimetres."},
      {.name = "size_m",
       .unit = units::m,
       .range = {0, 1e4, true},
       .when = built_in,
       .doc = "Largest extent of the shape; a teapot's is its width from spout to handle."},
      {.name = "fineness",
       .kind = ValueKind::integer,
       .range = {1, 64},
       .need = Need::defaulted,
       .fallback = "1",
       .when = built_in,
       .doc = "Multiplies the tessellation of a built-in shape."},
      {.name = "rotation_deg",
       .kind = ValueKind::vector3,
       .unit = units::deg,
       .range = {-360, 360},
       .need = Need::defaulted,
       .fallback = "[0, 0, 0]",
       .doc =
           "Turned about the rig's x axis, then its y axis, then its z axis, before it is moved."},
      {.name = "position_m",
       .kind = ValueKind::vector3,
       .unit = units::m,
       .range = {-1e4, 1e4},
       .need = Need::defaulted,
       .fallback = "[0, 0, 0]",
       .doc = "Where the origin of the mesh then stands, in the rig's frame."},
  };
  t.exactly_one = {{"mesh", "shape"}};
  return t;
}

TableSpec materials_table() {
  TableSpec t{.name = "materials",
              .need = Need::defaulted,
              .doc = "The materials whose statistics the plan and the reconstruction stand on."};
  t.keys = {
      {.name = "source",
       .kind = ValueKind::path,
       .need = Need::defaulted,
       .fallback = "\"builtin\"",
       .doc = "\"builtin\", or a folder of MERL .binary files."},
      {.name = "leave_out_families",
       .kind = ValueKind::texts,
       .need = Need::optional,
       .doc = "Families of the built-in set to hold out."},
      {.name = "leave_out",
       .kind = ValueKind::texts,
       .need = Need::optional,
       .doc = "Materials to hold out, by name."},
      {.name = "components",
       .kind = ValueKind::integer,
       .range = {0, 100000},
       .need = Need::defaulted,
       .fallback = "0",
       .doc = "Principal components kept; 0 keeps all that the materials support."},
      {.name = "layout",
       .kind = ValueKind::choice,
       .need = Need::defaulted,
       .fallback = "\"columns\"",
       .choices = {"columns", "stacked"},
       .doc = "\"columns\": one training column per material and channel. \"stacked\": one per "
              "material, its channels below each other, as in the paper."},
      {.name = "mapping",
       .kind = ValueKind::choice,
       .need = Need::defaulted,
       .fallback = "\"ln-floor\"",
       .choices = {"ln-floor", "ln-offset", "log-relative"},
       .doc =
           "How a reflectance f becomes the number that statistics are made of: ln max(f, floor), "
           "ln(f + floor), or Nielsen's log-relative mapping."},
      {.name = "floor_per_sr",
       .unit = units::per_sr,
       .range = {0, 1, true},
       .need = Need::defaulted,
       .fallback = "1e-4",
       .doc = "The floor of the mapping."},
  };
  return t;
}

// Which lights, how many, and what is made of them.
std::vector<KeySpec> choice_keys() {
  return {
      {.name = "criterion",
       .kind = ValueKind::choice,
       .need = Need::defaulted,
       .fallback = "\"condition\"",
       .choices = {"condition", "a-optimal"},
       .doc =
           "\"condition\": least condition number, as in the paper. \"a-optimal\": least expected "
           "error of the whole BRDF."},
      {.name = "stop",
       .kind = ValueKind::choice,
       .need = Need::defaulted,
       .fallback = "\"plateau\"",
       .choices = {"literal", "plateau", "count"},
       .doc =
           "\"literal\": until the criterion no longer falls. \"plateau\": until it falls by less "
           "than plateau_percent. \"count\": max_lights."},
      {.name = "plateau_percent",
       .unit = units::percent,
       .range = {0, 100},
       .need = Need::defaulted,
       .fallback = "20",
       .when = Condition{"stop", {"plateau"}},
       .doc = "A further light is not worth its time below this fall."},
      {.name = "max_lights",
       .kind = ValueKind::integer,
       .range = {1, 10000},
       .need = Need::defaulted,
       .fallback = "7",
       .doc = "Never more lights than this."},
      {.name = "estimator",
       .kind = ValueKind::choice,
       .need = Need::defaulted,
       .fallback = "\"map\"",
       .choices = {"map", "pseudo-inverse"},
       .doc = "\"map\": with the statistics as prior. \"pseudo-inverse\": the paper's."},
  };
}

// Which points of the surface a light is judged by.
std::vector<KeySpec> point_keys() {
  const KeySpec limit{
      .unit = units::deg, .range = {0, 90, true}, .need = Need::defaulted, .fallback = "80"};
  KeySpec d = limit, i = limit, o = limit;
  d.name = "max_theta_d_deg";
  d.doc = "Difference angles beyond this are neither planned nor measured; 90 leaves none out.";
  i.name = "max_theta_i_deg";
  i.doc = "The same for the angle between normal and lamp.";
  o.name = "max_theta_o_deg";
  o.doc = "The same for the angle between normal and camera.";
  return {
      {.name = "points",
       .kind = ValueKind::choice,
       .need = Need::defaulted,
       .fallback = "\"pixels\"",
       .choices = {"pixels", "vertices"},
       .doc = "Surface points: what camera pixels see, or mesh vertices as in the paper."},
      {.name = "pixel_stride",
       .kind = ValueKind::integer,
       .range = {1, 1024},
       .need = Need::defaulted,
       .fallback = "1",
       .when = Condition{"points", {"pixels"}},
       .doc = "Only every so many rows and columns."},
      {.name = "shadows",
       .kind = ValueKind::choice,
       .need = Need::defaulted,
       .fallback = "\"needed\"",
       .choices = {"needed", "all", "none"},
       .doc = "Shadow rays: the least that decide, one per lit point, or none (shadows ignored)."},
      d,
      i,
      o,
  };
}

std::vector<KeySpec> check_keys() {
  return {
      {.name = "held_out_lights",
       .kind = ValueKind::integer,
       .range = {0, 100},
       .need = Need::defaulted,
       .fallback = "1",
       .doc = "Lights captured but not fitted, whose images are predicted and compared."},
      {.name = "replan",
       .kind = ValueKind::boolean,
       .need = Need::defaulted,
       .fallback = "true",
       .doc = "While capturing, choose the remaining lights anew where earlier ones lost rows "
              "(saturated, dark, blocked) and others then promise more."},
      {.name = "random_baseline",
       .kind = ValueKind::boolean,
       .need = Need::defaulted,
       .fallback = "true",
       .doc = "Report what as many random lights would have given (simulation only)."},
      {.name = "seed",
       .kind = ValueKind::integer,
       .range = not_negative,
       .need = Need::defaulted,
       .fallback = "1",
       .doc = "Of the held-out choice and the random baseline."},
  };
}

TableSpec plan_table() {
  TableSpec t{.name = "plan",
              .need = Need::defaulted,
              .doc = "How lights are chosen and the BRDF is fitted."};
  for (const auto& part : {choice_keys(), point_keys(), check_keys()})
    t.keys.insert(t.keys.end(), part.begin(), part.end());
  return t;
}

TableSpec bracket_table() {
  TableSpec t{.name = "bracket", .doc = "The exposures of a shot."};
  t.keys = {
      {.name = "exposures_s",
       .kind = ValueKind::numbers,
       .unit = units::s,
       .range = {0, 3600, true},
       .doc = "Exposures on offer, shortest first."},
      {.name = "target_snr",
       .range = {0, 1e6, true},
       .need = Need::defaulted,
       .fallback = "50",
       .doc = "Signal over noise wanted of the darkest site worth measuring."},
      {.name = "metering",
       .kind = ValueKind::boolean,
       .need = Need::defaulted,
       .fallback = "true",
       .doc = "One metering frame per shot decides which of the exposures the scene needs."},
  };
  return t;
}

TableSpec stop_table() {
  TableSpec t{.name = "stop",
              .need = Need::defaulted,
              .doc = "When to stop before the planned lights are done; whichever comes first."};
  t.keys = {
      {.name = "predicted_error_percent",
       .unit = units::percent,
       .range = {0, 1000, true},
       .need = Need::optional,
       .doc = "Once the predicted error is this small."},
      {.name = "minutes",
       .unit = units::none,
       .range = {0, 100000, true},
       .need = Need::optional,
       .doc =
           "After so many minutes [min], and before a light that would not fit in what is left."},
      {.name = "lights",
       .kind = ValueKind::integer,
       .range = {1, 10000},
       .need = Need::optional,
       .doc = "After so many lights."},
  };
  return t;
}

TableSpec session_table() {
  TableSpec t{
      .name = "session", .need = Need::defaulted, .doc = "What is being captured, for the record."};
  t.keys = {
      {.name = "sample_id",
       .kind = ValueKind::identifier,
       .need = Need::defaulted,
       .fallback = "\"sample\"",
       .doc = "The sample; part of the session's folder name."},
      {.name = "operator",
       .kind = ValueKind::text,
       .need = Need::defaulted,
       .fallback = "\"\"",
       .doc = "Who captures it."},
      {.name = "notes",
       .kind = ValueKind::text,
       .need = Need::defaulted,
       .fallback = "\"\"",
       .doc = "Whatever should be remembered."},
      {.name = "reference",
       .kind = ValueKind::path,
       .need = Need::optional,
       .doc = "MERL .binary file of a known truth to report the error against."},
  };
  return t;
}

TableSpec describe_session() {
  TableSpec root{.name = "", .doc = "A session file."};
  root.foreign = {"rig",        "camera",   "gantry",     "lamp",
                  "interlocks", "keep_out", "candidates", "simulation"};
  root.foreign_why = "belongs to the rig file: a session may not change the rig";
  root.tables = session_tables();
  // Each may also stand in the rig file: that one of both is there is checked when both are known.
  for (TableSpec& table : root.tables)
    if (table.need == Need::required) table.need = Need::optional;
  return root;
}

}  // namespace

std::vector<TableSpec> session_tables() {
  return {object_table(),  materials_table(), plan_table(),
          bracket_table(), stop_table(),      session_table()};
}

const TableSpec& session_description() {
  static const TableSpec description = describe_session();
  return description;
}

}  // namespace lightrig
