// Writes what the checkout holds of the product's own making: the documents' lists of keys, the
// schemas, and the diagnostics beside config/faulty. After a deliberate change:
//   cmake --build --preset release --target write_generated && build/release/write_generated
// then read the difference before committing it.
#include <cstdio>
#include <exception>

#include "tests/config/generated_files.h"

int main() try {
  namespace test = lightrig::test;
  std::vector<test::GeneratedFile> all = test::generated_documents();
  for (std::filesystem::path file : test::faulty_files()) {
    const std::string text = test::read_faulty(file).text;
    all.push_back({file.replace_extension(".expected"), text});
  }
  int written = 0;
  for (const test::GeneratedFile& one : all) {
    if (test::bytes_of(one.file) == one.text) continue;
    std::ofstream out(one.file, std::ios::binary);
    if (!(out << one.text << std::flush))
      throw std::runtime_error("cannot write " + one.file.string());
    std::printf("%s\n", one.file.c_str());
    ++written;
  }
  std::printf("%d of %zu files differed\n", written, all.size());
} catch (const std::exception& failure) {
  std::fprintf(stderr, "write_generated: %s\n", failure.what());
  return 1;
}
