// The documents cannot drift from the reader: both are made from one description, and compared
// here. tests/write_generated.cpp makes them anew after a deliberate change.
#include <gtest/gtest.h>

#include <functional>
#include <set>
#include <string>

#include "config/descriptions.h"
#include "config/read_value.h"
#include "tests/config/generated_files.h"

namespace lightrig {
namespace {

TEST(Reference, InDocumentsAndSchemasIsWhatTheReaderReads) {
  for (const auto& [file, text] : test::generated_documents())
    EXPECT_TRUE(test::bytes_of(file) == text)
        << file << " does not describe what the reader reads: run write_generated";
}

using TableVisitor = std::function<void(const TableSpec&)>;
using KeyVisitor = std::function<void(const TableSpec&, const KeySpec&)>;

void for_each_table(const TableSpec& table, const TableVisitor& visit) {
  visit(table);
  for (const TableSpec& inner : table.tables) for_each_table(inner, visit);
}
void for_each_table(const TableVisitor& visit) {
  for (const TableSpec* root : {&rig_description(), &session_description(), &profile_description()})
    for_each_table(*root, visit);
}
void for_each_key(const KeyVisitor& visit) {
  for_each_table([&](const TableSpec& table) {
    for (const KeySpec& key : table.keys) visit(table, key);
  });
}

TEST(Descriptions, NameEveryUnitInTheKey) {
  for_each_key([](const TableSpec& table, const KeySpec& key) {
    EXPECT_TRUE(key.name.ends_with(key.unit.suffix))
        << table.name << "." << key.name << " is in " << key.unit.text;
  });
}

TEST(Descriptions, HaveADocSentenceAndADefaultThatIsLegal) {
  for_each_key([](const TableSpec& table, const KeySpec& key) {
    SCOPED_TRACE(table.name + "." + key.name);
    EXPECT_TRUE(key.doc.ends_with('.')) << key.doc;
    EXPECT_EQ(key.need == Need::defaulted, !key.fallback.empty());
    if (key.need == Need::defaulted) default_value(key);  // its promise is checked within
    if (key.kind == ValueKind::choice) {
      EXPECT_GE(key.choices.size(), 1U);
    }
  });
}

// Limits, speeds, accelerations, tolerance, settling, the lamp's maximum and its lease.
TEST(Descriptions, GiveNoDefaultToWhatCanHurt) {
  const std::set<std::string> dangerous = {"min_deg",
                                           "max_deg",
                                           "max_speed_deg_per_s",
                                           "max_acceleration_deg_per_s2",
                                           "home_deg",
                                           "tolerance_deg",
                                           "settle_s",
                                           "max_power",
                                           "max_on_time_s",
                                           "counts_per_deg",
                                           "min_mm",
                                           "max_mm",
                                           "max_speed_mm_per_s",
                                           "max_acceleration_mm_per_s2",
                                           "home_mm",
                                           "tolerance_mm",
                                           "counts_per_mm",
                                           "margin_m"};
  std::set<std::string> seen;
  for_each_key([&](const TableSpec& table, const KeySpec& key) {
    if (!dangerous.contains(key.name)) return;
    seen.insert(key.name);
    EXPECT_EQ(key.need, Need::required) << table.name << "." << key.name;
    EXPECT_FALSE(key.why.empty()) << key.name << ": a person will ask why";
  });
  EXPECT_EQ(seen, dangerous);
}

// An integer is handed on as int wherever it is not a seed, a raw constant or a count.
TEST(Descriptions, BoundEveryIntegerByWhatHoldsIt) {
  const std::set<std::string> wide = {"seed", "value", "min_position_counts",
                                      "max_position_counts"};
  for_each_key([&](const TableSpec& table, const KeySpec& key) {
    if (key.kind != ValueKind::integer || wide.contains(key.name)) return;
    EXPECT_GE(key.range.least, -2147483648.0) << table.name << "." << key.name;
    EXPECT_LE(key.range.most, 2147483647.0) << table.name << "." << key.name;
  });
}

TEST(Descriptions, HaveConditionsOnKeysThatStandBefore) {
  for_each_table([](const TableSpec& table) {
    std::set<std::string> before;
    for (const KeySpec& key : table.keys) {
      if (key.when) {
        EXPECT_TRUE(before.contains(key.when->key)) << table.name << "." << key.name;
      }
      EXPECT_TRUE(before.insert(key.name).second) << key.name << " twice in " << table.name;
    }
    for (const TableSpec& inner : table.tables) {
      if (inner.when) {
        EXPECT_TRUE(before.contains(inner.when->key)) << inner.name;
      }
    }
  });
}

}  // namespace
}  // namespace lightrig
