// The merge of a bracket: time against OpenCV's MergeDebevec (the usual tool, 8 bit only: it gets
// the same frames at 8 bit and a linear response), against the time that moving the bytes alone
// takes here, and its bias against known truth.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <ctime>
#include <opencv2/photo.hpp>
#include <random>

#include "core/merge_hdr.h"

namespace lightrig {
namespace {

constexpr int width = 2448, height = 2048;  // [px]

double cpu_seconds() {
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

template <class Work>
double best_of(int times, const Work& work) {
  double best = 1e9;
  for (int i = 0; i < times; ++i) {
    const double start = cpu_seconds();
    work();
    best = std::min(best, cpu_seconds() - start);
  }
  return best;
}

SensorModel bench_sensor() {
  SensorModel s;
  s.bits = 12;
  s.gain = 2.6;
  s.black_level = 64;
  s.read_noise = 5;
  s.dark_current = 2;
  s.full_well = 10400;
  s.response = Eigen::Array3d::Ones();
  s.min_exposure = 1e-5;
  s.max_exposure = 10;
  return s;
}

/// Poisson photons, Gaussian read noise, full well, rounding, clipping at an electron rate [e⁻/s].
std::uint16_t draw(const SensorModel& s, double rate, double t, std::mt19937_64& random) {
  const double mean = (rate + s.dark_current) * t;
  std::normal_distribution<double> normal;
  const double electrons = mean < 200
                               ? static_cast<double>(std::poisson_distribution<int>(mean)(random))
                               : std::round(mean + std::sqrt(mean) * normal(random));
  const double counts =
      s.black_level + (std::min(electrons, s.full_well) + s.read_noise * normal(random)) / s.gain;
  return static_cast<std::uint16_t>(
      std::clamp(std::round(counts), 0.0, static_cast<double>(s.white_level())));
}

const std::vector<double> bracket_times = {0.0005, 0.002, 0.008, 0.032,
                                           0.128,  0.512, 2.048};  // [s]

std::vector<Frame> bracket_of(const SensorModel& s, int w, int h, double low, double high) {
  std::mt19937_64 random(3);
  std::vector<Frame> frames;
  for (const double t : bracket_times) {
    Frame frame{{w, h, {}}, t, frames.size() + 1};
    const std::size_t sites = static_cast<std::size_t>(w) * static_cast<std::size_t>(h);
    for (std::size_t i = 0; i < sites; ++i) {
      const double u = static_cast<double>(i % static_cast<std::size_t>(w)) / std::max(1, w - 1);
      frame.counts.counts.push_back(draw(s, low * std::pow(high / low, u), t, random));
    }
    frames.push_back(std::move(frame));
  }
  return frames;
}

/// Seconds that Debevec's merge takes on the same frames at 8 bit, black level taken off.
double debevec_seconds(const std::vector<Frame>& frames, const SensorModel& s) {
  std::vector<cv::Mat> images;
  std::vector<float> times;
  for (const Frame& frame : frames) {
    cv::Mat image(height, width, CV_8UC1);
    for (std::size_t i = 0; i < frame.counts.counts.size(); ++i) {
      const double level =
          (frame.counts.counts[i] - s.black_level) * 255 / (s.white_level() - s.black_level);
      image.data[i] = static_cast<std::uint8_t>(std::clamp(level, 0.0, 255.0));
    }
    images.push_back(image);
    times.push_back(static_cast<float>(frame.exposure));
  }
  cv::Mat response(256, 1, CV_32FC1);
  for (int i = 0; i < 256; ++i) response.at<float>(i) = static_cast<float>(std::max(i, 1)) / 128.0F;
  const cv::Ptr<cv::MergeDebevec> merger = cv::createMergeDebevec();
  cv::setNumThreads(1);
  return best_of(3, [&] {
    cv::Mat hdr;
    merger->process(images, hdr, times, response);
  });
}

/// Bytes per second of copying arrays far larger than the caches, read and written bytes counted.
double bandwidth() {
  const std::size_t bytes = std::size_t{128} << 20;
  std::vector<char> from(bytes, 1), to(bytes, 0);
  return 2.0 * static_cast<double>(bytes) /
         best_of(5, [&] { std::memcpy(to.data(), from.data(), bytes); });
}

struct Bias {
  double worst = 0;  ///< [σ of one site]
  double error = 0;  ///< standard error of that figure
};

/// Mean of many sites of one radiance against that radiance, over nine decades of light.
Bias measure_bias(const SensorModel& s) {
  Bias out;
  fmt::print("{:>14}{:>14}{:>12}{:>14}{:>12}\n", "true e/s", "mean e/s", "sd", "bias [sd]",
             "+- [sd]");
  for (double rate = 0.1; rate < 2e7; rate *= 10) {
    const int side = 400;
    const std::vector<Frame> frames = bracket_of(s, side, side, rate, rate);
    const Result<RadianceImage> image = merge_hdr(frames, {}, s, {});
    double sum = 0, squares = 0;
    int n = 0;
    for (std::size_t i = 0; i < image->L.size(); ++i) {
      if (image->site[i] == RadianceImage::Site::saturated) continue;
      sum += double{image->L[i]};
      squares += double{image->L[i]} * double{image->L[i]};
      ++n;
    }
    if (n < side * side) {
      fmt::print("{:>14.4g}{:>14}\n", rate, "saturated");
      continue;
    }
    const double mean = sum / n, sd = std::sqrt(squares / n - mean * mean);
    const double bias = (mean - rate) / sd;
    fmt::print("{:>14.4g}{:>14.6g}{:>12.4g}{:>14.4f}{:>12.4f}\n", rate, mean, sd, bias,
               1 / std::sqrt(n));
    if (std::abs(bias) > std::abs(out.worst)) out = {bias, 1 / std::sqrt(n)};
  }
  return out;
}

int compare() {
  const SensorModel s = bench_sensor();
  const std::vector<Frame> frames = bracket_of(s, width, height, 2, 5e6);
  MergeOptions options;
  const double ours = best_of(5, [&] { (void)merge_hdr(frames, {}, s, options); });
  const double theirs = debevec_seconds(frames, s);
  const double rate = bandwidth();
  // Every count is read once; L, variance and the site's mark are written (and their lines
  // fetched).
  const double sites = static_cast<double>(width) * height;
  const double bytes =
      sites * (2.0 * static_cast<double>(frames.size()) + 2 * (2 * sizeof(float) + 1));
  const double floor = bytes / rate;
  fmt::print(
      "{} exposures of {} x {} px, one thread, processor seconds, frames and result in memory\n",
      frames.size(), width, height);
  fmt::print(
      "lightrig {:.3f} s; OpenCV MergeDebevec (8 bit) {:.3f} s; bytes alone {:.4f} s at {:.1f} "
      "GB/s\n",
      ours, theirs, floor, rate / 1e9);
  const Bias bias = measure_bias(s);
  fmt::print("speedup_debevec={:.2f} bandwidth_fraction={:.3f} bias_sigma={:.4f}\n", theirs / ours,
             floor / ours, bias.worst);
  return 0;
}

}  // namespace
}  // namespace lightrig

int main() { return lightrig::compare(); }
