#pragma once

#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

namespace lightrig {

/// A temporary folder of raw arrays for a baseline in another language; gone with this object.
class ProblemFolder {
 public:
  ProblemFolder() {
    std::string name = (std::filesystem::temp_directory_path() / "lightrig-bench-XXXXXX").string();
    path_ = ::mkdtemp(name.data());
  }
  ~ProblemFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  ProblemFolder(const ProblemFolder&) = delete;
  ProblemFolder& operator=(const ProblemFolder&) = delete;

  /// `kind` is numpy's name of the type, `shape` the sizes separated by blanks.
  template <class T>
  void write(const std::string& name, const char* kind, const std::string& shape, const T* data,
             std::size_t count) const {
    std::ofstream bytes(path_ / (name + ".bin"), std::ios::binary);
    bytes.write(reinterpret_cast<const char*>(data),
                static_cast<std::streamsize>(count * sizeof(T)));
    std::ofstream(path_ / "sizes.txt", std::ios::app)
        << name << ' ' << kind << ' ' << shape << '\n';
  }
  template <class T>
  std::vector<T> read(const std::string& name, std::size_t count) const {
    std::vector<T> values(count);
    std::ifstream(path_ / (name + ".bin"), std::ios::binary)
        .read(reinterpret_cast<char*>(values.data()),
              static_cast<std::streamsize>(count * sizeof(T)));
    return values;
  }
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

}  // namespace lightrig
