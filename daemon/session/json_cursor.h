#pragma once

#include <cmath>
#include <cstdint>
#include <limits>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace lightrig {

/// A place in a JSON document that is being read. The first thing that is not as expected is noted
/// with its path ("lights[2].gantry_axes[0]"); after it every read yields a harmless default, so
/// that a reader is written without a branch per value and asks once at the end.
class JsonCursor {
 public:
  using Json = nlohmann::ordered_json;

  JsonCursor(const Json& document, std::string& problem) : JsonCursor(&document, "", problem) {}

  JsonCursor operator[](const char* key) const {
    const std::string path = path_.empty() ? key : path_ + "." + key;
    if (node_ == nullptr) return {nullptr, path, *problem_};
    if (!node_->is_object() || !node_->contains(key)) {
      note(path, "is missing");
      return {nullptr, path, *problem_};
    }
    return {&(*node_)[key], path, *problem_};
  }

  bool has(const char* key) const {
    return node_ != nullptr && node_->is_object() && node_->contains(key);
  }
  bool is_null() const { return node_ != nullptr && node_->is_null(); }

  /// The items of a list.
  std::vector<JsonCursor> items() const {
    std::vector<JsonCursor> list;
    if (node_ == nullptr) return list;
    if (!node_->is_array()) {
      note(path_, "is not a list");
      return list;
    }
    for (std::size_t i = 0; i < node_->size(); ++i) {
      list.push_back({&(*node_)[i], path_ + "[" + std::to_string(i) + "]", *problem_});
    }
    return list;
  }

  double number() const {
    if (node_ != nullptr && node_->is_number()) return node_->get<double>();
    note(path_, "is not a number");
    return 0;
  }
  /// JSON has no infinity: it is written as null.
  double number_or_infinity() const {
    return is_null() ? std::numeric_limits<double>::infinity() : number();
  }
  std::int64_t integer() const {
    if (node_ != nullptr && node_->is_number_integer()) return node_->get<std::int64_t>();
    note(path_, "is not a whole number");
    return 0;
  }
  int small_integer() const {
    const std::int64_t value = integer();
    if (value >= std::numeric_limits<int>::min() && value <= std::numeric_limits<int>::max()) {
      return static_cast<int>(value);
    }
    note(path_, "is out of range");
    return 0;
  }
  bool boolean() const {
    if (node_ != nullptr && node_->is_boolean()) return node_->get<bool>();
    note(path_, "is not true or false");
    return false;
  }
  std::string text() const {
    if (node_ != nullptr && node_->is_string()) return node_->get<std::string>();
    note(path_, "is not a text");
    return {};
  }
  std::vector<double> numbers() const {
    std::vector<double> list;
    for (const JsonCursor& item : items()) list.push_back(item.number());
    return list;
  }
  std::vector<std::string> texts() const {
    std::vector<std::string> list;
    for (const JsonCursor& item : items()) list.push_back(item.text());
    return list;
  }

  /// Notes what is wrong with the value here.
  void reject(const std::string& why) const { note(path_, why); }

 private:
  JsonCursor(const Json* node, std::string path, std::string& problem)
      : node_(node), path_(std::move(path)), problem_(&problem) {}

  void note(const std::string& path, const std::string& why) const {
    if (problem_->empty()) *problem_ = (path.empty() ? "the document" : path) + " " + why;
  }

  const Json* node_;
  std::string path_;
  std::string* problem_;
};

}  // namespace lightrig
