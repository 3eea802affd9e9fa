#include "config/reference.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "config/json_text.h"
#include "config/read_value.h"

namespace lightrig {
namespace {

std::string header_of(const TableSpec& table, const std::string& path) {
  if (table.repeat == Repeat::list) return fmt::format("[[{}]]", path);
  if (table.repeat == Repeat::named) return fmt::format("[{}.NAME]", path);
  return fmt::format("[{}]", path);
}

std::string condition_text(const Condition& condition) {
  if (condition.values.empty()) return fmt::format("beside `{}`", condition.key);
  return fmt::format("with `{} = \"{}\"`", condition.key,
                     fmt::join(condition.values, "\"` or `\""));
}

std::string need_text(const TableSpec& table) {
  return fmt::format("{}{}.", table.need == Need::required ? "Required" : "Optional",
                     table.when ? fmt::format(" {}", condition_text(*table.when)) : "");
}

// "|" would end the cell.
std::string cell_text(std::string text) {
  for (auto at = text.find('|'); at != std::string::npos; at = text.find('|', at + 2))
    text.insert(at, 1, '\\');
  return text;
}

std::string default_text(const KeySpec& key, const TableSpec& table) {
  const bool grouped = std::ranges::any_of(table.exactly_one, [&](const auto& group) {
    return std::ranges::find(group, key.name) != group.end();
  });
  if (grouped) return "one of the marked ¹";
  if (key.need == Need::required) return "**required**";
  return key.need == Need::defaulted ? fmt::format("`{}`", key.fallback) : "none";
}

std::string row_of(const KeySpec& key, const TableSpec& table) {
  std::string doc = key.doc;
  if (key.when) doc += fmt::format(" Only {}.", condition_text(*key.when));
  if (!key.why.empty()) doc += fmt::format(" No default: {}.", key.why);
  return fmt::format("| `{}` | {} | {} | {} |\n", key.name, cell_text(phrase(key)),
                     cell_text(default_text(key, table)), cell_text(doc));
}

std::string tables_text(const TableSpec& table, const std::string& path) {
  std::string text;
  if (!path.empty()) {
    text +=
        fmt::format("### `{}`\n\n{} {}\n\n", header_of(table, path), table.doc, need_text(table));
    if (table.free_form) text += "Any keys; texts, numbers, `true` or `false`.\n\n";
    for (const auto& group : table.exactly_one)
      text += fmt::format("¹ Exactly one of `{}`.\n\n", fmt::join(group, "`, `"));
    if (!table.keys.empty()) text += "| key | value | default | meaning |\n|---|---|---|---|\n";
    for (const KeySpec& key : table.keys) text += row_of(key, table);
    if (!table.keys.empty()) text += "\n";
  }
  for (const TableSpec& inner : table.tables) {
    const std::string within = table.repeat == Repeat::named ? path + ".NAME" : path;
    text += tables_text(inner, within.empty() ? inner.name : within + "." + inner.name);
  }
  return text;
}

using Json = nlohmann::ordered_json;

Json number_schema(const KeySpec& key, const char* type) {
  Json schema{{"type", type}};
  if (std::isfinite(key.range.least))
    schema[key.range.without_least ? "exclusiveMinimum" : "minimum"] = key.range.least;
  if (std::isfinite(key.range.most)) schema["maximum"] = key.range.most;
  return schema;
}

Json list_schema(Json items, const std::vector<int>& sizes) {
  Json schema{{"type", "array"}, {"items", std::move(items)}};
  schema["minItems"] = sizes.empty() ? 1 : *std::ranges::min_element(sizes);
  if (!sizes.empty()) schema["maxItems"] = *std::ranges::max_element(sizes);
  return schema;
}

Json type_schema(const KeySpec& key) {
  switch (key.kind) {
    case ValueKind::number:
      return number_schema(key, "number");
    case ValueKind::integer:
      return number_schema(key, "integer");
    case ValueKind::boolean:
      return {{"type", "boolean"}};
    case ValueKind::text:
      return {{"type", "string"}};
    case ValueKind::identifier:
      return {{"type", "string"}, {"pattern", "^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$"}};
    case ValueKind::choice:
      return {{"enum", key.choices}};
    case ValueKind::path:
      return {{"type", "string"}, {"minLength", 1}};
    case ValueKind::vector3:
      return list_schema(number_schema(key, "number"), {3});
    case ValueKind::channels:
      return {{"anyOf",
               {number_schema(key, "number"), list_schema(number_schema(key, "number"), {3})}}};
    case ValueKind::numbers:
      return list_schema(number_schema(key, "number"), key.sizes);
    case ValueKind::integers:
      return list_schema(number_schema(key, "integer"), key.sizes);
    case ValueKind::texts:
      return list_schema({{"type", "string"}}, key.sizes);
    case ValueKind::vectors:
      return list_schema(list_schema(number_schema(key, "number"), {3}), key.sizes);
  }
  return {};
}

Json default_json(const KeySpec& key) {
  const Value value = default_value(key);
  return std::visit(
      [&](const auto& v) -> Json {
        using T = std::decay_t<decltype(v)>;
        if constexpr (std::is_same_v<T, std::vector<double>>) {
          return key.kind == ValueKind::channels && v.size() == 1 ? Json(v[0]) : Json(v);
        } else if constexpr (std::is_same_v<T, std::vector<Eigen::Vector3d>>) {
          Json list = Json::array();
          for (const Eigen::Vector3d& p : v) list.push_back({p.x(), p.y(), p.z()});
          return list;
        } else {
          return Json(v);
        }
      },
      value);
}

Json key_schema(const KeySpec& key) {
  Json schema = type_schema(key);
  schema["description"] = key.doc;
  if (key.need == Need::defaulted) schema["default"] = default_json(key);
  return schema;
}

// Whether a condition holds where its key is not written down.
bool holds_by_default(const Condition& condition, const TableSpec& table) {
  const KeySpec* key = find_key(table, condition.key);
  if (key == nullptr || key->need != Need::defaulted || key->kind != ValueKind::choice)
    return false;
  const std::string value = std::get<std::string>(default_value(*key));
  return std::ranges::find(condition.values, value) != condition.values.end();
}

Json condition_schema(const Condition& condition, const TableSpec& table, const std::string& name,
                      bool required) {
  Json holds = Json::object();
  if (!condition.values.empty())
    holds["properties"] = {{condition.key, {{"enum", condition.values}}}};
  if (condition.values.empty() || !holds_by_default(condition, table))
    holds["required"] = {condition.key};
  Json schema{{"if", holds}};
  if (required) schema["then"] = {{"required", {name}}};
  schema["else"] = {{"properties", {{name, false}}}};
  return schema;
}

Json table_schema(const TableSpec& table);

Json repeated_schema(const TableSpec& table) {
  Json one = table_schema(table);
  if (table.repeat == Repeat::list) return {{"type", "array"}, {"minItems", 1}, {"items", one}};
  if (table.repeat == Repeat::named)
    return {{"type", "object"}, {"description", table.doc}, {"additionalProperties", one}};
  return one;
}

Json table_schema(const TableSpec& table) {
  Json schema{{"type", "object"}, {"description", table.doc}};
  if (table.free_form) {
    schema["additionalProperties"] = {{"type", {"string", "number", "boolean"}}};
    return schema;
  }
  schema["additionalProperties"] = false;
  Json properties = Json::object(), required = Json::array(), rules = Json::array();
  const auto add = [&](const std::string& name, Json one, bool needed, bool grouped,
                       const std::optional<Condition>& when) {
    properties[name] = std::move(one);
    if (when) rules.push_back(condition_schema(*when, table, name, needed && !grouped));
    if (needed && !when && !grouped) required.push_back(name);
  };
  for (const KeySpec& key : table.keys) {
    const bool grouped = std::ranges::any_of(table.exactly_one, [&](const auto& group) {
      return std::ranges::find(group, key.name) != group.end();
    });
    add(key.name, key_schema(key), key.need == Need::required, grouped, key.when);
  }
  for (const TableSpec& inner : table.tables)
    add(inner.name, repeated_schema(inner), inner.need == Need::required, false, inner.when);
  for (const auto& group : table.exactly_one) {
    Json one_of = Json::array();
    for (const std::string& name : group) one_of.push_back({{"required", {name}}});
    rules.push_back({{"oneOf", one_of}});
  }
  schema["properties"] = properties;
  if (!required.empty()) schema["required"] = required;
  if (!rules.empty()) schema["allOf"] = rules;
  return schema;
}

}  // namespace

std::string key_reference(const TableSpec& root) { return tables_text(root, ""); }

std::string json_schema(const TableSpec& root, const std::string& title) {
  Json schema{{"$schema", "http://json-schema.org/draft-07/schema#"}, {"title", title}};
  schema.update(table_schema(root));
  return json_text(schema, 2) + "\n";
}

}  // namespace lightrig
