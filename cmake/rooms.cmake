# lightrig_room(NAME LINKS...) makes one static library of the .cpp files of the calling folder. A file belongs to a
# room by lying in its folder. Optional parts lie in a sub-folder named after their option; see lightrig_optional.
function(lightrig_room name)
  file(GLOB sources CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/*.cpp)
  list(FILTER sources EXCLUDE REGEX "(_absent|/main)\\.cpp$")
  add_library(lightrig_${name} STATIC ${sources})
  target_include_directories(lightrig_${name} PUBLIC ${PROJECT_SOURCE_DIR})
  target_link_libraries(lightrig_${name} PUBLIC ${ARGN})
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
