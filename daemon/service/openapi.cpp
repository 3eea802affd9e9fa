#include <algorithm>
#include <cctype>
#include <nlohmann/json.hpp>
#include <string_view>

#include "config/json_text.h"
#include "daemon/service/api.h"

namespace lightrig {
namespace {

using Json = nlohmann::ordered_json;

Json body_schema(const Route& route) {
  Json properties = Json::object();
  Json required = Json::array();
  for (const BodyField& field : route.body) {
    properties[field.name] = {{"type", field.type}, {"description", field.description}};
    if (field.required) required.push_back(field.name);
  }
  Json schema{
      {"type", "object"}, {"properties", std::move(properties)}, {"additionalProperties", false}};
  if (!required.empty()) schema["required"] = std::move(required);
  return schema;
}

Json parameters_of(const Route& route, bool mutation) {
  Json parameters = Json::array();
  if (std::string_view(route.path).find("{id}") != std::string_view::npos)
    parameters.push_back(
        {{"name", "id"},
         {"in", "path"},
         {"required", true},
         {"schema", {{"type", "string"}, {"pattern", "^[A-Za-z0-9_-][A-Za-z0-9._-]*$"}}}});
  if (mutation) {
    parameters.push_back({{"name", "X-Lightrig"},
                          {"in", "header"},
                          {"required", true},
                          {"schema", {{"type", "string"}, {"const", "1"}}}});
    parameters.push_back({{"name", "X-Lightrig-Client"},
                          {"in", "header"},
                          {"description", "who asks, for the lock and the record"},
                          {"schema", {{"type", "string"}}}});
  }
  return parameters;
}

// "/v1/sessions/{id}/pause" + POST → "post_sessions_id_pause"
std::string operation_id(const Route& route) {
  std::string name = route.method;
  for (char& c : name) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  std::string_view path = route.path;
  if (path.starts_with("/v1")) path.remove_prefix(3);
  for (char c : path) {
    if (c == '/' || c == '.')
      name += '_';
    else if (c != '{' && c != '}')
      name += c;
  }
  return name;
}

Json operation_of(const Route& route) {
  const bool mutation = route.kind == Route::Kind::mutation || route.kind == Route::Kind::unlocked;
  const Json error{
      {"description", "refused; the message says why and what to do"},
      {"content", {{"application/json", {{"schema", {{"$ref", "#/components/schemas/Error"}}}}}}}};
  Json operation{
      {"operationId", operation_id(route)},
      {"summary", route.summary},
      {"parameters", parameters_of(route, mutation)},
      {"responses",
       {{"2XX", {{"description", "done, or taken on"}}}, {"4XX", error}, {"5XX", error}}}};
  if (mutation)
    operation["requestBody"] = {
        {"required", !route.body.empty() && route.body.front().required},
        {"content", {{"application/json", {{"schema", body_schema(route)}}}}}};
  if (route.kind == Route::Kind::page) operation["security"] = Json::array();
  return operation;
}

}  // namespace

std::string openapi_document() {
  Json paths = Json::object();
  for (const Route& route : Api::routes()) {
    std::string method = route.method;
    std::transform(method.begin(), method.end(), method.begin(),
                   [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    paths[route.path][method] = operation_of(route);
  }
  const Json error_schema{
      {"type", "object"},
      {"properties",
       {{"error",
         {{"type", "object"},
          {"properties", {{"code", {{"type", "string"}}}, {"message", {{"type", "string"}}}}},
          {"required", {"code", "message"}}}}}},
      {"required", {"error"}}};
  const Json document{
      {"openapi", "3.1.0"},
      {"info",
       {{"title", "lightrigd control API"},
        {"version", "1"},
        {"description", "The Unix socket needs no token; TCP needs a bearer token."}}},
      {"security", Json::array({Json::object(), {{"token", Json::array()}}})},
      {"paths", std::move(paths)},
      {"components",
       {{"schemas", {{"Error", error_schema}}},
        {"securitySchemes", {{"token", {{"type", "http"}, {"scheme", "bearer"}}}}}}}};
  return json_text(document, 2) + "\n";
}

}  // namespace lightrig
