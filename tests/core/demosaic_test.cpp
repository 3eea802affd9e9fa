#include "core/demosaic.h"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>
#include <random>

namespace lightrig {
namespace {

RadianceImage mosaic_of(const cv::Mat& counts, ColorFilter filter) {
  RadianceImage image;
  image.width = counts.cols;
  image.height = counts.rows;
  image.filter = filter;
  for (int r = 0; r < counts.rows; ++r) {
    for (int c = 0; c < counts.cols; ++c) {
      image.L.push_back(counts.at<std::uint16_t>(r, c));
      image.variance.push_back(4);
      image.site.push_back(RadianceImage::Site::measured);
    }
  }
  return image;
}

TEST(Demosaic, AgreesWithOpenCvsBilinearToItsRounding) {
  std::mt19937 random(1);
  cv::Mat counts(24, 30, CV_16U);
  for (int r = 0; r < counts.rows; ++r)
    for (int c = 0; c < counts.cols; ++c)
      counts.at<std::uint16_t>(r, c) = static_cast<std::uint16_t>(random() % 60000);
  // OpenCV names a pattern by the second row's second and third site: RGGB is its "BG".
  const std::vector<std::pair<ColorFilter, int>> filters{
      {ColorFilter::bayer_rggb, cv::COLOR_BayerBG2BGR},
      {ColorFilter::bayer_grbg, cv::COLOR_BayerGB2BGR},
      {ColorFilter::bayer_gbrg, cv::COLOR_BayerGR2BGR},
      {ColorFilter::bayer_bggr, cv::COLOR_BayerRG2BGR}};
  for (const auto& [filter, code] : filters) {
    cv::Mat bgr;
    cv::demosaicing(counts, bgr, code);
    const RadianceImage mosaic = mosaic_of(counts, filter);
    for (int channel = 0; channel < 3; ++channel) {
      const RadianceImage plane = demosaiced(mosaic, channel);
      EXPECT_EQ(plane.filter, ColorFilter::mono);
      for (int r = 1; r + 1 < counts.rows; ++r)
        for (int c = 1; c + 1 < counts.cols; ++c)
          ASSERT_NEAR(plane.L[static_cast<std::size_t>(r * counts.cols + c)],
                      bgr.at<cv::Vec3w>(r, c)[2 - channel], 0.51F)
              << "channel " << channel << " row " << r << " column " << c;
    }
  }
}

TEST(Demosaic, CarriesVarianceAndNeverCallsASaturatedNeighbourhoodMeasured) {
  cv::Mat counts(6, 6, CV_16U, cv::Scalar(100));
  RadianceImage mosaic = mosaic_of(counts, ColorFilter::bayer_rggb);
  // Row 1, column 1 is blue: red is the mean of four, green of four, blue itself.
  const std::size_t site = 7;
  EXPECT_FLOAT_EQ(demosaiced(mosaic, 0).variance[site], 1);
  EXPECT_FLOAT_EQ(demosaiced(mosaic, 1).variance[site], 1);
  EXPECT_FLOAT_EQ(demosaiced(mosaic, 2).variance[site], 4);
  mosaic.site[0] = RadianceImage::Site::saturated;  // a red site
  EXPECT_EQ(demosaiced(mosaic, 0).site[site], RadianceImage::Site::saturated);
  EXPECT_EQ(demosaiced(mosaic, 2).site[site], RadianceImage::Site::measured);
  // A corner without four neighbours is the mean of those there are.
  EXPECT_EQ(demosaiced(mosaic, 2).L[0], 100);
}

}  // namespace
}  // namespace lightrig
