#include "config/descriptions.h"

namespace lightrig {
namespace {

TableSpec rig_table() {
  TableSpec t{.name = "rig", .doc = "The rig as a whole."};
  t.keys = {
      {.name = "name", .kind = ValueKind::text, .doc = "What people call it."},
      {.name = "session_root",
       .kind = ValueKind::path,
       .need = Need::defaulted,
       .fallback = "\"sessions\"",
       .doc = "Folder that sessions are stored in."},
  };
  return t;
}

TableSpec interlocks_table() {
  TableSpec t{.name = "interlocks",
              .repeat = Repeat::named,
              .need = Need::optional,
              .doc = "An input that forbids motion while open, such as [interlocks.door]."};
  t.keys = {
      {.name = "input",
       .kind = ValueKind::text,
       .doc = "Modbus: an input of the controller profile. GRBL: \"door\", \"hold\", \"reset\" or "
              "\"probe\"."},
      {.name = "resume_by_itself",
       .kind = ValueKind::boolean,
       .need = Need::defaulted,
       .fallback = "false",
       .doc = "Whether a paused session goes on once the input closes again."},
  };
  return t;
}

KeySpec by_itself() {
  return {.name = "resume_by_itself",
          .kind = ValueKind::boolean,
          .need = Need::defaulted,
          .fallback = "false",
          .doc =
              "Whether the session goes on once the reading is below the lower bound; otherwise "
              "it waits for a person, whose word counts as soon as it is no longer above the "
              "upper one."};
}

TableSpec packet_loss_table() {
  TableSpec t{.name = "packet_loss",
              .need = Need::optional,
              .doc =
                  "Packets that the camera lost or had to send again, on average over the last "
                  "frames. While paused, dark frames are taken to see whether they still go "
                  "astray."};
  t.keys = {
      {.name = "pause_above_per_frame",
       .unit = units::per_frame,
       .range = not_negative,
       .doc = "More than this pauses the session."},
      {.name = "resume_below_per_frame",
       .unit = units::per_frame,
       .range = not_negative,
       .doc = "As few as this, over all the frames looked at, and it may go on."},
      {.name = "over_frames",
       .kind = ValueKind::integer,
       .range = {1, 1000},
       .need = Need::defaulted,
       .fallback = "20",
       .doc = "Frames looked at: the last so many."},
      by_itself(),
  };
  return t;
}

TableSpec lamp_drift_table() {
  TableSpec t{.name = "lamp_drift",
              .need = Need::optional,
              .doc =
                  "The lamp's light, measured by a reference frame: the gantry goes back to the "
                  "first light captured and takes one of its frames again; the reading is how "
                  "far the median of the lit sites' ratio is from 1."};
  t.keys = {
      {.name = "pause_above_percent",
       .unit = units::percent,
       .range = {0, 100, true},
       .doc = "More than this, up or down, pauses the session."},
      {.name = "resume_below_percent",
       .unit = units::percent,
       .range = {0, 100, true},
       .doc = "As little as this and it may go on."},
      {.name = "every_lights",
       .kind = ValueKind::integer,
       .range = {1, 100000},
       .need = Need::defaulted,
       .fallback = "5",
       .doc = "A reference frame after every so many lights."},
      {.name = "recheck_minutes",
       .unit = units::minutes,
       .range = {0, 1440, true},
       .need = Need::defaulted,
       .fallback = "5",
       .doc =
           "Time between two reference frames while the session is paused for drift; the lamp is "
           "dark between them."},
      by_itself(),
  };
  return t;
}

TableSpec temperature_table(const char* name, const char* doc) {
  TableSpec t{.name = name, .need = Need::optional, .doc = doc};
  t.keys = {
      {.name = "pause_above_c",
       .unit = units::celsius,
       .range = {-40, 300},
       .doc = "Hotter than this pauses the session."},
      {.name = "resume_below_c",
       .unit = units::celsius,
       .range = {-40, 300},
       .doc = "As cool as this and it may go on."},
      by_itself(),
  };
  return t;
}

TableSpec pause_table() {
  TableSpec t{.name = "pause",
              .need = Need::optional,
              .doc =
                  "Conditions that pause a session, lamp dark, between two lights; what is not "
                  "named is not watched. An open interlock and a full disk always do."};
  t.keys = {
      {.name = "wrong_pose",
       .kind = ValueKind::boolean,
       .need = Need::defaulted,
       .fallback = "false",
       .doc = "Wait for a person before the next light once the pictures of two lights show the "
              "object elsewhere than [object] says; else it is journaled and warned of."},
  };
  t.tables = {packet_loss_table(), lamp_drift_table(),
              temperature_table("lamp_temperature",
                                "The lamp's own sensor, where the rig file names one "
                                "(lamp.modbus.temperature)."),
              temperature_table("camera_temperature",
                                "The camera's own sensor (GenICam's DeviceTemperature).")};
  return t;
}

TableSpec keep_out_table() {
  const Condition box{"shape", {"box"}}, sphere{"shape", {"sphere"}};
  TableSpec t{.name = "keep_out",
              .repeat = Repeat::named,
              .need = Need::optional,
              .doc = "A volume that lamp and arm may not enter, such as [keep_out.tripod]."};
  t.keys = {
      {.name = "shape",
       .kind = ValueKind::choice,
       .choices = {"box", "sphere"},
       .doc = "Its shape."},
      {.name = "min_m",
       .kind = ValueKind::vector3,
       .unit = units::m,
       .range = {-1e4, 1e4},
       .when = box,
       .doc = "Least x, y, z of the box."},
      {.name = "max_m",
       .kind = ValueKind::vector3,
       .unit = units::m,
       .range = {-1e4, 1e4},
       .when = box,
       .doc = "Greatest x, y, z of the box."},
      {.name = "centre_m",
       .kind = ValueKind::vector3,
       .unit = units::m,
       .range = {-1e4, 1e4},
       .when = sphere,
       .doc = "Centre of the sphere."},
      {.name = "radius_m",
       .unit = units::m,
       .range = {0, 1e4, true},
       .when = sphere,
       .doc = "Radius of the sphere."},
  };
  return t;
}

TableSpec candidates_table() {
  TableSpec t{
      .name = "candidates",
      .need = Need::defaulted,
      .doc = "The lamp positions a plan may choose from, before the gantry's reach is asked."};
  t.keys = {
      {.name = "rule",
       .kind = ValueKind::choice,
       .need = Need::defaulted,
       .fallback = "\"fibonacci\"",
       .choices = {"fibonacci", "list", "grid"},
       .doc =
           "\"fibonacci\": evenly over the whole sphere of directions. \"list\": positions written "
           "down. \"grid\": every combination of evenly spaced axis values. Of fixed lamps every "
           "one is a candidate, whatever the rule."},
      {.name = "count",
       .kind = ValueKind::integer,
       .range = {1, 1000000},
       .need = Need::defaulted,
       .fallback = "1000",
       .when = Condition{"rule", {"fibonacci"}},
       .doc = "How many directions."},
      {.name = "positions_m",
       .kind = ValueKind::vectors,
       .unit = units::m,
       .range = {-1e4, 1e4},
       .when = Condition{"rule", {"list"}},
       .doc = "Lamp positions; for a distant lamp directions of any length. On a turntable as seen "
              "from the object before it turns."},
      {.name = "sphere_radius_m",
       .unit = units::m,
       .range = {0, 100, true},
       .need = Need::optional,
       .when = Condition{"rule", {"fibonacci"}},
       .doc = "Linear axes: radius of the sphere that the positions lie on; what the axes do not "
              "reach of it is left out."},
      {.name = "sphere_centre_m",
       .kind = ValueKind::vector3,
       .unit = units::m,
       .range = {-1e3, 1e3},
       .need = Need::defaulted,
       .fallback = "[0, 0, 0]",
       .when = Condition{"rule", {"fibonacci"}},
       .doc = "Linear axes: its centre."},
      {.name = "steps",
       .kind = ValueKind::integers,
       .range = {1, 10000},
       .sizes = {1, 2, 3},
       .when = Condition{"rule", {"grid"}},
       .doc = "How many values of each axis, in the order azimuth, elevation; x, y, z; turn, "
              "elevation. Ends included, but not twice of a whole turn. A head on linear axes is "
              "aimed, not stepped."},
  };
  return t;
}

TableSpec simulation_table() {
  TableSpec t{.name = "simulation",
              .need = Need::optional,
              .doc =
                  "What --simulate makes of this rig; a real run never reads "
                  "it."};
  t.keys = {
      {.name = "material",
       .kind = ValueKind::text,
       .doc = "What the object is made of: a built-in material (`lightrig materials list`), or the "
              "path of a MERL .binary file."},
      {.name = "seed",
       .kind = ValueKind::integer,
       .range = not_negative,
       .need = Need::defaulted,
       .fallback = "1",
       .doc = "Of all that is left to chance."},
      {.name = "clock_rate",
       .range = {1, std::numeric_limits<double>::infinity(), false, true},
       .need = Need::defaulted,
       .fallback = "1",
       .doc = "How many times faster than real waiting passes on the simulated rig (the host's own "
              "work takes the time it takes); inf waits for nothing."},
      {.name = "arm_frequency_hz",
       .unit = units::hz,
       .range = {0, 1e6},
       .need = Need::defaulted,
       .fallback = "0",
       .doc = "Natural frequency of the arm that carries the lamp; 0 is rigid."},
      {.name = "arm_damping",
       .range = {0, 10, true},
       .need = Need::defaulted,
       .fallback = "0.05",
       .doc = "Its damping ratio."},
      {.name = "pose_error_deg",
       .unit = units::deg,
       .range = {0, 180},
       .need = Need::defaulted,
       .fallback = "0",
       .doc = "Rotation of the real object against the modelled one."},
      {.name = "lamp_position_error_mm",
       .unit = units::mm,
       .range = {0, 1e4},
       .need = Need::defaulted,
       .fallback = "0",
       .doc = "Error of the lamp's real position, rms, the same at every visit."},
      {.name = "obstacle_m",
       .kind = ValueKind::vector3,
       .range = {-1e4, 1e4},
       .need = Need::optional,
       .doc = "Where a ball stands that the rig's model knows nothing of; it takes light from the "
              "object."},
      {.name = "obstacle_radius_mm",
       .unit = units::mm,
       .range = {0, 1e4, true},
       .need = Need::defaulted,
       .fallback = "10",
       .doc = "Radius of that ball."},
      {.name = "ambient_w_per_m2_sr",
       .kind = ValueKind::channels,
       .unit = units::radiance,
       .range = not_negative,
       .need = Need::defaulted,
       .fallback = "0",
       .doc = "Radiance that the camera sees with the lamp off."},
      {.name = "lamp_drift_percent_per_hour",
       .unit = units::per_hour,
       .range = {-100, 10000},
       .need = Need::defaulted,
       .fallback = "0",
       .doc =
           "By which the lamp brightens (or, below 0, fades) on the simulated clock. Frames then "
           "depend on when they are taken."},
  };
  return t;
}

TableSpec describe_rig() {
  TableSpec root{.name = "", .doc = "A rig file."};
  root.tables = {rig_table(),      camera_table(),     gantry_table(),
                 lamp_table(),     interlocks_table(), pause_table(),
                 keep_out_table(), candidates_table(), simulation_table()};
  for (TableSpec table : session_tables()) {
    // A rig file may leave them to the session file.
    if (table.need == Need::required) table.need = Need::optional;
    root.tables.push_back(std::move(table));
  }
  return root;
}

}  // namespace

const TableSpec& rig_description() {
  static const TableSpec description = describe_rig();
  return description;
}

}  // namespace lightrig
