#include "config/section.h"

#include <fmt/format.h>

#include <algorithm>

#include "config/utf8.h"
#include "core/check.h"

namespace lightrig {

const Cell& Section::cell(const std::string& key) const {
  const auto at = std::ranges::find_if(cells, [&](const Cell& c) { return c.spec->name == key; });
  CHECK(at != cells.end());
  return *at;
}

template <class T>
const T& Section::get(const std::string& key) const {
  const Cell& c = cell(key);
  CHECK(c.value.has_value());
  const T* value = std::get_if<T>(&*c.value);
  CHECK(value != nullptr);
  return *value;
}

bool Section::has(const std::string& key) const { return cell(key).value.has_value(); }
bool Section::given_key(const std::string& key) const { return cell(key).given; }
Place Section::at(const std::string& key) const { return cell(key).place; }
Place Section::at(const std::string& key, std::size_t item) const {
  const Cell& c = cell(key);
  return item < c.items.size() ? c.items[item] : c.place;
}

double Section::number(const std::string& key) const {
  return get<double>(key) * cell(key).spec->unit.si;
}
int Section::integer(const std::string& key) const {
  return static_cast<int>(get<std::int64_t>(key));
}
std::int64_t Section::whole(const std::string& key) const { return get<std::int64_t>(key); }
std::uint64_t Section::seed(const std::string& key) const {
  return static_cast<std::uint64_t>(get<std::int64_t>(key));
}
bool Section::boolean(const std::string& key) const { return get<bool>(key); }
const std::string& Section::text(const std::string& key) const { return get<std::string>(key); }
std::filesystem::path Section::file(const std::string& key) const {
  const std::filesystem::path written(text(key));
  const Source* source = cell(key).place.source;
  if (written.empty() || written.is_absolute() || source == nullptr) return written;
  return (source->file.parent_path() / written).lexically_normal();
}
Eigen::Vector3d Section::vector3(const std::string& key) const {
  const std::vector<double> v = numbers(key);
  return {v[0], v[1], v[2]};
}
Eigen::Array3d Section::channels(const std::string& key) const {
  const std::vector<double> v = numbers(key);
  if (v.size() == 1) return Eigen::Array3d::Constant(v[0]);
  return {v[0], v[1], v[2]};
}
std::vector<double> Section::numbers(const std::string& key) const {
  std::vector<double> v = get<std::vector<double>>(key);
  for (double& x : v) x *= cell(key).spec->unit.si;
  return v;
}
std::vector<int> Section::integers(const std::string& key) const {
  const auto& v = get<std::vector<std::int64_t>>(key);
  return {v.begin(), v.end()};
}
const std::vector<std::string>& Section::texts(const std::string& key) const {
  return get<std::vector<std::string>>(key);
}
std::vector<Eigen::Vector3d> Section::vectors(const std::string& key) const {
  std::vector<Eigen::Vector3d> v = get<std::vector<Eigen::Vector3d>>(key);
  for (Eigen::Vector3d& x : v) x *= cell(key).spec->unit.si;
  return v;
}

const Section* Section::find(const std::string& table) const {
  const auto at =
      std::ranges::find_if(sections, [&](const Section& s) { return s.spec->name == table; });
  return at == sections.end() ? nullptr : &*at;
}
const Section& Section::table(const std::string& table) const {
  const Section* found = find(table);
  CHECK(found != nullptr);
  return *found;
}
std::vector<const Section*> Section::all(const std::string& table) const {
  std::vector<const Section*> found;
  for (const Section& s : sections)
    if (s.spec->name == table) found.push_back(&s);
  return found;
}

namespace {

Diagnostic diagnostic_at(const Place& place, std::string message, std::string suggestion) {
  Diagnostic d;
  if (place.source != nullptr) {
    d.file = place.source->file;
    if (place.line > 0) d.source_line = line_of(place.source->text, place.line);
  }
  d.line = place.line;
  d.column = place.column;
  d.length = place.length;
  d.message = std::move(message);
  d.suggestion = std::move(suggestion);
  return d;
}

}  // namespace

void Findings::error(const Place& place, std::string message, std::string suggestion) {
  add(diagnostic_at(place, std::move(message), std::move(suggestion)));
}
void Findings::warning(const Place& place, std::string message, std::string suggestion) {
  Diagnostic d = diagnostic_at(place, std::move(message), std::move(suggestion));
  d.severity = Diagnostic::Severity::warning;
  add(std::move(d));
}
void Findings::add(Diagnostic diagnostic) { found_.push_back(std::move(diagnostic)); }

std::vector<Diagnostic> Findings::sorted() const {
  std::vector<std::filesystem::path> files;
  for (const Diagnostic& d : found_)
    if (std::ranges::find(files, d.file) == files.end()) files.push_back(d.file);
  const auto rank = [&](const Diagnostic& d) {
    return std::tuple(std::ranges::find(files, d.file) - files.begin(), d.line, d.column);
  };
  std::vector<Diagnostic> all = found_;
  std::ranges::stable_sort(
      all, [&](const Diagnostic& a, const Diagnostic& b) { return rank(a) < rank(b); });
  return all;
}

namespace {

std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') out += '\\';
    if (c == '\n')
      out += "\\n";
    else if (c == '\t')
      out += "\\t";
    else
      out += c;
  }
  return out + "\"";
}

struct Writer {
  std::string operator()(bool v) const { return v ? "true" : "false"; }
  std::string operator()(std::int64_t v) const { return fmt::format("{}", v); }
  std::string operator()(double v) const { return fmt::format("{}", v); }
  std::string operator()(const std::string& v) const { return quoted(v); }
  std::string operator()(const Eigen::Vector3d& v) const {
    return fmt::format("[{}, {}, {}]", v.x(), v.y(), v.z());
  }
  template <class T>
  std::string operator()(const std::vector<T>& list) const {
    std::string out = "[";
    for (const T& item : list) out += (out.size() > 1 ? ", " : "") + (*this)(item);
    return out + "]";
  }
};

}  // namespace

std::string to_toml(const Value& value) { return std::visit(Writer{}, value); }

}  // namespace lightrig
