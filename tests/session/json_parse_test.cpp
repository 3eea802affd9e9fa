// Documents that come from outside: read whole, or refused with the place.
#include "daemon/session/json_parse.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

namespace lightrig {
namespace {

using testing::HasSubstr;

std::string nested(int lists) {
  const auto n = static_cast<std::size_t>(lists);
  return std::string(n, '[') + std::string(n, ']');
}

TEST(ParseJson, TakesSixtyFourLevelsAndNotOneMore) {
  ASSERT_TRUE(parse_json(nested(64)));
  const auto deeper = parse_json("{\n \"plan\": " + nested(64) + "}");
  ASSERT_FALSE(deeper);
  EXPECT_EQ(deeper.error().code, ErrorCode::invalid_input);
  EXPECT_THAT(deeper.error().message, HasSubstr("64 levels at line 2, column 73"));
}

// Found as a crash: copying and writing such a document overran the stack.
TEST(ParseJson, RefusesADocumentThatWouldOverrunTheStack) {
  EXPECT_FALSE(parse_json(nested(400000)));
  EXPECT_FALSE(parse_json("{\"plan\":" + std::string(400000, '[')));
}

TEST(ParseJson, CountsNoBracketInAString) {
  const std::string text = R"({"a":")" + std::string(500, '[') + R"(\"[{[","b":[1]})";
  const auto json = parse_json(text);
  ASSERT_TRUE(json) << json.error().message;
  EXPECT_EQ(json->at("b").at(0), 1);
}

TEST(ParseJson, SaysWhereItIsNoJson) {
  EXPECT_THAT(parse_json("{\n  \"a\": nope\n}").error().message, HasSubstr("line 2"));
  EXPECT_THAT(parse_json("{\"a\": [1, 2").error().message, HasSubstr("cut short"));
  EXPECT_THAT(parse_json("").error().message, HasSubstr("cut short"));
  EXPECT_THAT(parse_json("[1e999]").error().message, HasSubstr("no double"));
}

TEST(ParseJson, RefusesAnObjectOfVeryManyMembersAndCountsEachObjectApart) {
  const auto object_of = [](int count) {
    std::string text = "{";
    for (int i = 0; i < count; ++i)
      text += (i > 0 ? "," : "") + ("\"" + std::to_string(i) + ":\":{\"a\":1}");
    return text + "}";
  };
  EXPECT_TRUE(parse_json(object_of(most_members)));
  EXPECT_TRUE(parse_json("[" + object_of(most_members) + "," + object_of(most_members) + "]"));
  const auto refused = parse_json(object_of(most_members + 1));
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("more than 1024 members in one object at line 1"),
            std::string::npos)
      << refused.error().message;
}

}  // namespace
}  // namespace lightrig
