#include "config/read_value.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>

#include "config/suggest.h"
#include "core/check.h"

namespace lightrig {
namespace {

using Kind = TomlNode::Kind;

// 320.0 must not look like the integer 320.
std::string with_point(double number) {
  std::string text = fmt::format("{}", number);
  return text.find_first_not_of("-0123456789") == std::string::npos ? text + ".0" : text;
}

// The node as it stands in the file, for "found …".
std::string found(const TomlNode& node) {
  switch (node.kind) {
    case Kind::text:
      return "the text " + to_toml(Value(node.text));
    case Kind::integer:
      return fmt::format("the integer {}", node.integer);
    case Kind::number:
      return "the number " + with_point(node.number);
    case Kind::boolean:
      return node.boolean ? "true" : "false";
    case Kind::array:
      return node.items.empty() ? "an empty list" : fmt::format("a list of {}", node.items.size());
    default:
      return name_of(node.kind);
  }
}

// What to do about the commonest wrong types.
std::string type_remedy(const TomlNode& node, const KeySpec& key) {
  const bool numeric = key.kind == ValueKind::number || key.kind == ValueKind::integer ||
                       key.kind == ValueKind::channels;
  if (node.kind == Kind::text && numeric) {
    double number = 0;
    const char* end = node.text.data() + node.text.size();
    const auto [at, error] = std::from_chars(node.text.data(), end, number);
    if (error == std::errc{} && at == end) return "did you mean " + node.text + ", without quotes?";
    if (error == std::errc{}) return "write the number alone: the unit is in the key's name";
  }
  if (node.kind == Kind::integer && key.kind == ValueKind::boolean)
    return std::string("did you mean ") + (node.integer != 0 ? "true" : "false") + "?";
  if (node.kind == Kind::text && key.kind == ValueKind::boolean &&
      (node.text == "true" || node.text == "false"))
    return "did you mean " + node.text + ", without quotes?";
  if (node.kind == Kind::number && key.kind == ValueKind::integer &&
      node.number == std::floor(node.number) && std::abs(node.number) < 1e15)
    return fmt::format("did you mean {:.0f}?", node.number);
  return {};
}

class ValueReader {
 public:
  ValueReader(const KeySpec& key, const std::string& name, Findings& findings)
      : key_(key), name_(name), findings_(findings) {}

  std::optional<Value> read(const TomlNode& node) {
    switch (key_.kind) {
      case ValueKind::number:
        return as_value(number(node, name_));
      case ValueKind::integer:
        return as_value(integer(node, name_));
      case ValueKind::boolean:
        if (node.kind == Kind::boolean) return Value(node.boolean);
        return wrong_type(node);
      case ValueKind::text:
      case ValueKind::path:
      case ValueKind::identifier:
      case ValueKind::choice:
        return as_value(text(node, name_));
      case ValueKind::vector3:
        return as_value(list<double>(node, &ValueReader::number, {3}));
      case ValueKind::channels:
        if (node.kind != Kind::array) {
          const auto one = number(node, name_);
          return one ? std::optional<Value>(std::vector<double>{*one}) : std::nullopt;
        }
        return as_value(list<double>(node, &ValueReader::number, {3}));
      case ValueKind::numbers:
        return as_value(list<double>(node, &ValueReader::number, key_.sizes));
      case ValueKind::integers:
        return as_value(list<std::int64_t>(node, &ValueReader::integer, key_.sizes));
      case ValueKind::texts:
        return as_value(list<std::string>(node, &ValueReader::text, key_.sizes));
      case ValueKind::vectors:
        return as_value(list<Eigen::Vector3d>(node, &ValueReader::vector3, key_.sizes));
    }
    return std::nullopt;
  }

 private:
  template <class T>
  std::optional<Value> as_value(std::optional<T> value) {
    return value ? std::optional<Value>(std::move(*value)) : std::nullopt;
  }

  std::nullopt_t wrong_type(const TomlNode& node, const std::string& name) {
    const std::string wanted = name == name_ ? phrase(key_) : item_phrase(key_);
    findings_.error(node.place,
                    fmt::format("{} must be {}, found {}", name, with_article(wanted), found(node)),
                    type_remedy(node, key_));
    return std::nullopt;
  }
  std::nullopt_t wrong_type(const TomlNode& node) { return wrong_type(node, name_); }

  bool in_range(const TomlNode& node, double value, const std::string& name) {
    const Range& r = key_.range;
    if (std::isnan(value) || (std::isinf(value) && !r.infinite)) {
      findings_.error(node.place, fmt::format("{} is {}; it must be a finite number", name, value));
      return false;
    }
    const bool low = r.without_least ? value <= r.least : value < r.least;
    if (!low && value <= r.most) return true;
    findings_.error(node.place, fmt::format("{} is {}{}; it must be {}", name, value,
                                            after_number(key_.unit), range_phrase(key_)));
    return false;
  }

  std::optional<double> number(const TomlNode& node, const std::string& name) {
    if (node.kind != Kind::number && node.kind != Kind::integer) return wrong_type(node, name);
    if (!in_range(node, node.number, name)) return std::nullopt;
    return node.number;
  }

  std::optional<std::int64_t> integer(const TomlNode& node, const std::string& name) {
    if (node.kind != Kind::integer) return wrong_type(node, name);
    if (!in_range(node, node.number, name)) return std::nullopt;
    return node.integer;
  }

  std::optional<std::string> text(const TomlNode& node, const std::string& name) {
    if (node.kind != Kind::text) return wrong_type(node, name);
    if (node.text.find('\0') != std::string::npos) {
      findings_.error(node.place, name + " holds a zero byte");
      return std::nullopt;
    }
    if (key_.kind == ValueKind::choice &&
        std::ranges::find(key_.choices, node.text) == key_.choices.end()) {
      findings_.error(node.place,
                      fmt::format("{} is \"{}\"; it must be {}", name, node.text, phrase(key_)),
                      did_you_mean(node.text, key_.choices));
      return std::nullopt;
    }
    if (key_.kind == ValueKind::identifier && !is_identifier(node.text)) {
      findings_.error(node.place,
                      fmt::format("{} is \"{}\"; it must be a name of 1 to 64 letters, digits, "
                                  "\".\", \"_\" or \"-\" that begins with a letter or digit",
                                  name, node.text));
      return std::nullopt;
    }
    if (key_.kind == ValueKind::path && node.text.empty()) {
      findings_.error(node.place, name + " is empty; it must name a file or folder");
      return std::nullopt;
    }
    return node.text;
  }

  template <class T>
  using Item = std::optional<T> (ValueReader::*)(const TomlNode&, const std::string&);

  std::optional<Eigen::Vector3d> vector3(const TomlNode& node, const std::string& name) {
    const auto v = list_at<double>(node, &ValueReader::number, {3}, name);
    if (!v) return std::nullopt;
    return Eigen::Vector3d((*v)[0], (*v)[1], (*v)[2]);
  }

  template <class T>
  std::optional<std::vector<T>> list(const TomlNode& node, Item<T> item,
                                     const std::vector<int>& sizes) {
    return list_at<T>(node, item, sizes, name_);
  }

  // Every item is looked at, so that all that is wrong with a list is said at once.
  template <class T>
  std::optional<std::vector<T>> list_at(const TomlNode& node, Item<T> item,
                                        const std::vector<int>& sizes, const std::string& name) {
    if (node.kind != Kind::array) return wrong_type(node, name);
    const int n = static_cast<int>(node.items.size());
    const bool fits = sizes.empty() ? n >= 1 : std::ranges::find(sizes, n) != sizes.end();
    if (!fits) {
      findings_.error(node.place, fmt::format("{} has {} items; it must be {}", name, n,
                                              sizes.empty() ? "a list of at least one"
                                                            : with_article(phrase(key_))));
      return std::nullopt;
    }
    std::vector<T> values;
    for (int i = 0; i < n; ++i) {
      auto value = (this->*item)(node.items[static_cast<std::size_t>(i)],
                                 fmt::format("{}[{}]", name, i + 1));
      if (value) values.push_back(std::move(*value));
    }
    if (static_cast<int>(values.size()) < n) return std::nullopt;
    return values;
  }

  static bool is_identifier(const std::string& text) {
    const auto letter = [](char c) {
      return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9');
    };
    return !text.empty() && text.size() <= 64 && letter(text[0]) &&
           std::ranges::all_of(
               text, [&](char c) { return letter(c) || c == '.' || c == '_' || c == '-'; });
  }

  const KeySpec& key_;
  const std::string& name_;
  Findings& findings_;
};

}  // namespace

std::optional<Value> read_value(const TomlNode& node, const KeySpec& key,
                                const std::string& full_name, Findings& findings) {
  return ValueReader(key, full_name, findings).read(node);
}

Value default_value(const KeySpec& key) {
  Source source{"default", "value = " + key.fallback + "\n"};
  const auto tree = parse_toml(source);
  CHECK(tree.has_value());
  Findings findings;
  const auto value = read_value(tree->entries.at(0).value, key, key.name, findings);
  CHECK(value.has_value());
  return *value;
}

}  // namespace lightrig
