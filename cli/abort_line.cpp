#include "cli/abort_line.h"

#include <cstddef>
#include <map>

namespace lightrig::cli {

std::optional<AbortLine> read_abort_line(const std::vector<std::string>& words,
                                         const ServiceOptions& otherwise) {
  AbortLine line{otherwise, {}, {}};
  std::string given;
  const std::map<std::string, std::string*> values{
      {"--socket", &line.service.socket}, {"--as", &line.service.as}, {"--reason", &given}};
  std::vector<std::string> plain;
  for (std::size_t i = 0; i < words.size(); ++i) {
    const std::string& word = words[i];
    if (!word.starts_with('-')) {
      plain.push_back(word);
      continue;
    }
    const auto equals = word.find('=');
    const auto value = values.find(word.substr(0, equals));
    if (word == "--json") {
      line.service.json = true;
    } else if (value == values.end()) {
      line.unknown.push_back(word);
    } else if (equals != word.npos) {
      *value->second = word.substr(equals + 1);
    } else if (i + 1 < words.size() && !words[i + 1].starts_with('-')) {
      *value->second = words[++i];
    } else {
      line.unknown.push_back(word + " without a value");
    }
  }
  if (plain.empty() || plain.front() != "abort") return {};
  plain.front() = given;
  for (const std::string& word : plain)
    if (!word.empty()) line.reason += (line.reason.empty() ? "" : " ") + word;
  return line;
}

}  // namespace lightrig::cli
