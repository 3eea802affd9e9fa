#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <string>
#include <variant>
#include <vector>

#include "config/key_spec.h"
#include "config/toml_tree.h"

namespace lightrig {

using Value =
    std::variant<bool, std::int64_t, double, std::string, std::vector<double>,
                 std::vector<std::int64_t>, std::vector<std::string>, std::vector<Eigen::Vector3d>>;

/// One key of a table as it was read: given, or by default.
struct Cell {
  const KeySpec* spec = nullptr;
  bool given = false;
  bool applies = true;         ///< its neighbours make it legal; else a default without effect
  Place key_place;             ///< of the key; by default: of the table's header
  Place place;                 ///< of the value
  std::vector<Place> items;    ///< lists: of every item
  std::optional<Value> value;  ///< as written, in the key's own unit; empty where it is unusable
};

/// A table of a file after its keys have met their descriptions: every value has the type, unit and
/// range its KeySpec promises. Getters convert to SI and radians. Asking for a key that the
/// description does not have, or that has no value, is a broken promise of ours.
class Section {
 public:
  const TableSpec* spec = nullptr;
  std::string path;  ///< "camera.sensor"; list items "gantry.axis[2]"
  std::string name;  ///< named tables: the name the person chose
  Place place;       ///< of the header; line 0 where the table is not written down
  bool given = false;
  std::vector<Cell> cells;        ///< one per key of the description, in its order
  std::vector<Section> sections;  ///< tables within, in the order of the description
  std::vector<std::pair<std::string, std::string>> free_form;  ///< key and value as text

  bool has(const std::string& key) const;        ///< a usable value, given or by default
  bool given_key(const std::string& key) const;  ///< written in the file
  Place at(const std::string& key) const;        ///< of the value
  Place at(const std::string& key, std::size_t item) const;

  double number(const std::string& key) const;  ///< SI
  int integer(const std::string& key) const;
  std::int64_t whole(const std::string& key) const;  ///< an integer beyond int
  std::uint64_t seed(const std::string& key) const;
  bool boolean(const std::string& key) const;
  const std::string& text(const std::string& key) const;
  std::filesystem::path file(const std::string& key) const;  ///< resolved against the file's folder
  Eigen::Vector3d vector3(const std::string& key) const;
  Eigen::Array3d channels(const std::string& key) const;
  std::vector<double> numbers(const std::string& key) const;
  std::vector<int> integers(const std::string& key) const;
  const std::vector<std::string>& texts(const std::string& key) const;
  std::vector<Eigen::Vector3d> vectors(const std::string& key) const;

  const Section* find(const std::string& table) const;  ///< the one, or nullptr
  const Section& table(const std::string& table) const;
  std::vector<const Section*> all(const std::string& table) const;

 private:
  const Cell& cell(const std::string& key) const;
  template <class T>
  const T& get(const std::string& key) const;
};

/// Collects what is wrong with a set of files.
class Findings {
 public:
  void error(const Place& place, std::string message, std::string suggestion = {});
  void warning(const Place& place, std::string message, std::string suggestion = {});
  void add(Diagnostic diagnostic);
  bool has_error() const { return lightrig::has_error(found_); }
  /// In the order of the file, files in the order they were first spoken of.
  std::vector<Diagnostic> sorted() const;

 private:
  std::vector<Diagnostic> found_;
};

/// Reads a document by its description: unknown keys, wrong types, values out of range, missing and
/// conflicting keys all go to `findings`; what is usable is in the section returned. The tree's
/// source and the description must outlive it.
Section read_section(const TomlNode& document, const TableSpec& description, const Source& source,
                     Findings& findings);

/// A value as one writes it in TOML.
std::string to_toml(const Value& value);

}  // namespace lightrig
