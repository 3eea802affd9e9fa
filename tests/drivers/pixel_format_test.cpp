#include "drivers/pixel_format.h"

#include <gtest/gtest.h>

#include <set>
#include <vector>

namespace lightrig {
namespace {

std::vector<std::byte> bytes(std::initializer_list<int> values) {
  std::vector<std::byte> out;
  for (int value : values) out.push_back(static_cast<std::byte>(value));
  return out;
}

TEST(PixelFormat, UnpacksGigEVisionsMono12PackedAsTheStandardDrawsIt) {
  // 0xABC and 0x123: high bytes AB and 12 outside, low nibbles C (first, low) and 3 (second, high)
  // between.
  const auto image = unpack(*find_pixel_format("Mono12Packed"), bytes({0xAB, 0x3C, 0x12}), 2, 1);
  ASSERT_TRUE(image) << image.error().message;
  EXPECT_EQ(image->counts, (std::vector<std::uint16_t>{0xABC, 0x123}));
}

TEST(PixelFormat, UnpacksMono10PackedWithTwoLowBitsEach) {
  // 0x3FD = 11'1111'1101: high byte FF, low bits 01; 0x002: high byte 00, low bits 10.
  const auto image = unpack(*find_pixel_format("Mono10Packed"), bytes({0xFF, 0x21, 0x00}), 2, 1);
  ASSERT_TRUE(image);
  EXPECT_EQ(image->counts, (std::vector<std::uint16_t>{0x3FD, 0x002}));
}

TEST(PixelFormat, UnpacksPfncMono12pLeastSignificantBitFirst) {
  // 0xABC then 0x123 as a bit stream from the low end: BC, 3A, 12.
  const auto image = unpack(*find_pixel_format("Mono12p"), bytes({0xBC, 0x3A, 0x12}), 2, 1);
  ASSERT_TRUE(image);
  EXPECT_EQ(image->counts, (std::vector<std::uint16_t>{0xABC, 0x123}));
}

TEST(PixelFormat, ReadsWordsLittleEndian) {
  const auto image = unpack(*find_pixel_format("BayerRG12"), bytes({0xBC, 0x0A}), 1, 1);
  ASSERT_TRUE(image);
  EXPECT_EQ(image->counts, (std::vector<std::uint16_t>{0xABC}));
}

TEST(PixelFormat, EveryFormatGivesBackWhatWasPackedForEvenAndOddSizes) {
  for (const PixelFormat& format : pixel_formats()) {
    for (const auto& [width, height] : {std::pair{4, 3}, std::pair{5, 3}, std::pair{1, 1}}) {
      RawImage image{width, height, {}};
      std::uint32_t state = 12345;
      for (int i = 0; i < width * height; ++i) {
        state = state * 1664525U + 1013904223U;
        image.counts.push_back(
            static_cast<std::uint16_t>((state >> 8) & ((1U << format.bits) - 1)));
      }
      const auto packed = pack(format, image);
      ASSERT_EQ(packed.size(), payload_bytes(format, width, height)) << format.name;
      const auto back = unpack(format, packed, width, height);
      ASSERT_TRUE(back) << format.name;
      EXPECT_EQ(back->counts, image.counts) << format.name << " " << width << "×" << height;
    }
  }
}

TEST(PixelFormat, RefusesAPayloadOfTheWrongSizeWithBothSizes) {
  const auto image = unpack(*find_pixel_format("Mono16"), bytes({1, 2, 3}), 2, 1);
  ASSERT_FALSE(image);
  EXPECT_EQ(image.error().code, ErrorCode::invalid_input);
  EXPECT_NE(image.error().message.find("4 bytes"), std::string::npos) << image.error().message;
  EXPECT_NE(image.error().message.find("has 3"), std::string::npos) << image.error().message;
}

TEST(PixelFormat, CodesAreUniqueAndTheirSizeFieldTellsBitsPerPixel) {
  std::set<std::uint32_t> codes;
  for (const PixelFormat& format : pixel_formats()) {
    EXPECT_TRUE(codes.insert(format.code).second) << format.name;
    // PFNC: bits 16–23 are the bits a pixel occupies.
    const auto occupied = static_cast<int>((format.code >> 16) & 0xff);
    EXPECT_EQ(payload_bytes(format, 8, 1) * 8, static_cast<std::size_t>(8 * occupied))
        << format.name;
  }
}

}  // namespace
}  // namespace lightrig
