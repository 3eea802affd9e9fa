#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <set>
#include <string>

#include "daemon/service/api.h"
#include "daemon/service/api_body.h"
#include "daemon/service/log.h"

namespace lightrig {
namespace {

using Json = nlohmann::ordered_json;

TEST(OpenApi, DescribesEveryRouteAndNoOther) {
  const Json document = Json::parse(openapi_document());
  std::set<std::string> described, served;
  for (const auto& [path, operations] : document["paths"].items())
    for (const auto& [method, operation] : operations.items()) {
      std::string upper = method;
      for (char& c : upper) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
      described.insert(upper + " " + path);
      EXPECT_FALSE(operation["summary"].get<std::string>().empty());
    }
  for (const Route& route : Api::routes())
    served.insert(std::string(route.method) + " " + route.path);
  EXPECT_EQ(described, served);
}

TEST(OpenApi, GivesEveryOperationANameOfItsOwn) {
  const Json document = Json::parse(openapi_document());
  std::set<std::string> names;
  std::size_t operations = 0;
  for (const auto& [path, methods] : document["paths"].items())
    for (const auto& [method, operation] : methods.items()) {
      names.insert(operation["operationId"].get<std::string>());
      ++operations;
    }
  EXPECT_EQ(names.size(), operations);
}

TEST(OpenApi, DemandsTheHeaderOfEveryMutation) {
  const Json document = Json::parse(openapi_document());
  for (const auto& [path, methods] : document["paths"].items())
    for (const auto& [method, operation] : methods.items()) {
      if (method == "get") continue;
      EXPECT_NE(operation["parameters"].dump().find("X-Lightrig\""), std::string::npos) << path;
      EXPECT_TRUE(operation.contains("requestBody")) << path;
    }
}

TEST(RequestBody, NamesAnUnknownMemberAndWhatThereIs) {
  const std::vector<BodyField> fields{{"session_path", "string", false, "a path"},
                                      {"force", "boolean", false, "a flag"},
                                      {"power", "number", true, "how bright"}};
  const auto body = check_body(R"({"power":1,"sesion_path":"/x"})", fields);
  ASSERT_FALSE(body);
  EXPECT_NE(body.error().message.find("sesion_path"), std::string::npos);
  EXPECT_NE(body.error().message.find("session_path"), std::string::npos);
  EXPECT_TRUE(check_body(R"({"power":0.5,"force":true})", fields));
  for (const char* wrong : {R"({"power":1,"force":"true"})", R"({"power":1,"force":1})",
                            R"({"power":"1"})", R"({"force":true})", "", "[]", "{"})
    EXPECT_FALSE(check_body(wrong, fields)) << wrong;
  EXPECT_TRUE(check_body("", {})) << "a body may be left out where nothing is asked for";
}

TEST(RequestBody, ReadsDegreesAndMillimetresAsTheAxisIs) {
  Axis azimuth;
  azimuth.name = "azimuth";
  Axis rail;
  rail.name = "rail";
  rail.rotary = false;
  Axis lamp;
  lamp.name = "lamp";
  lamp.rotary = false;
  lamp.selector = true;
  const std::vector<Axis> axes{azimuth, rail, lamp};
  EXPECT_DOUBLE_EQ(jog_body(R"({"axis":"azimuth","by_deg":180})", axes)->value, 3.141592653589793);
  EXPECT_DOUBLE_EQ(jog_body(R"({"axis":"rail","to_mm":250})", axes)->value, 0.25);
  EXPECT_DOUBLE_EQ(jog_body(R"({"axis":"lamp","to":3})", axes)->value, 3);
  EXPECT_FALSE(jog_body(R"({"axis":"lamp","to_mm":3})", axes));
  EXPECT_TRUE(jog_body(R"({"axis":"azimuth","by_deg":1})", axes)->relative);
  EXPECT_FALSE(jog_body(R"({"axis":"rail","to_mm":1})", axes)->relative);
  for (const char* wrong :
       {R"({"axis":"rail","by_deg":1})", R"({"axis":"azimuth"})", R"({"by_deg":1})", "[]", "{",
        R"({"axis":"azimuth","by_deg":"1"})", R"({"axis":"azimuth","by_deg":1,"to_deg":2})"})
    EXPECT_FALSE(jog_body(wrong, axes)) << wrong;
}

}  // namespace
}  // namespace lightrig
