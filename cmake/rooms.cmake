# What nearly every source reads, parsed once per target. It saves a third of a build from nothing. The presets for developing build without
# (CMAKE_DISABLE_PRECOMPILE_HEADERS), so that a source which forgets an include does not pass.
set(LIGHTRIG_COMMON_HEADERS <Eigen/Dense> <fmt/format.h> <tl/expected.hpp> <algorithm> <array> <chrono> <cmath> <filesystem> <fstream>
  <functional> <map> <memory> <mutex> <optional> <span> <string> <string_view> <thread> <variant> <vector>)

# lightrig_precompile(TARGET HEADERS…): the common headers and these. GCC 12 forgets that a precompiled header was a system header and then
# reports, wrongly, on the insides of std::string (GCC bugs 105329, 105651); the presets without precompiled headers keep these warnings.
function(lightrig_precompile target)
  target_precompile_headers(${target} PRIVATE ${LIGHTRIG_COMMON_HEADERS} ${ARGN})
  if(NOT CMAKE_DISABLE_PRECOMPILE_HEADERS)
    target_compile_options(${target} PRIVATE -Wno-restrict -Wno-stringop-overflow -Wno-array-bounds)
  endif()
endfunction()

# lightrig_room(NAME LINKS...) makes one static library of the .cpp files of the calling folder. A file belongs to a
# room by lying in its folder. Optional parts lie in a sub-folder named after their option; see lightrig_optional.
function(lightrig_room name)
  file(GLOB sources CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/*.cpp)
  list(FILTER sources EXCLUDE REGEX "(_absent|/main)\\.cpp$")
  add_library(lightrig_${name} STATIC ${sources})
  target_include_directories(lightrig_${name} PUBLIC ${PROJECT_SOURCE_DIR})
  target_link_libraries(lightrig_${name} PUBLIC ${ARGN})
  # The two rooms at the end of the row are few files with headers of their own each: nothing to gain.
  if(NOT name MATCHES "^(service|cli)$")
    lightrig_precompile(lightrig_${name})
  endif()
endfunction()

# lightrig_optional(ROOM OPTION PART LINKS...): with OPTION on, the files of PART/ and LINKS; with it off the twin
# PART_absent.cpp, which answers every call of the same header with not_built and the remedy. Never an #ifdef.
function(lightrig_optional room option part)
  if(${option})
    file(GLOB sources CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/${part}/*.cpp)
    target_sources(lightrig_${room} PRIVATE ${sources})
    target_link_libraries(lightrig_${room} PRIVATE ${ARGN})
  else()
    target_sources(lightrig_${room} PRIVATE ${CMAKE_CURRENT_SOURCE_DIR}/${part}_absent.cpp)
  endif()
endfunction()
