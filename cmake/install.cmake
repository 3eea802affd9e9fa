# `cmake --install` lays out a working system; with -DCMAKE_INSTALL_PREFIX=/usr the units are where systemd looks.
include(GNUInstallDirs)
# Installing and packing take what is built: they need not build the tests first.
set(CMAKE_SKIP_INSTALL_ALL_DEPENDENCY ON)
install(TARGETS lightrig lightrigd RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
install(DIRECTORY config/ DESTINATION ${CMAKE_INSTALL_DATADIR}/lightrig/config
        FILES_MATCHING PATTERN "*.toml" PATTERN "faulty" EXCLUDE)
install(DIRECTORY docs/ DESTINATION ${CMAKE_INSTALL_DOCDIR})
install(FILES README.md LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR} OPTIONAL)

# The unit names where the program is installed, which is known when it is: a package has another prefix than this build.
install(CODE "
  set(CMAKE_INSTALL_FULL_BINDIR \"\${CMAKE_INSTALL_PREFIX}/${CMAKE_INSTALL_BINDIR}\")
  set(CMAKE_INSTALL_FULL_DOCDIR \"\${CMAKE_INSTALL_PREFIX}/${CMAKE_INSTALL_DOCDIR}\")
  configure_file(\"${PROJECT_SOURCE_DIR}/systemd/lightrigd.service.in\" \"${CMAKE_BINARY_DIR}/lightrigd.service\" @ONLY)")
install(FILES ${CMAKE_BINARY_DIR}/lightrigd.service systemd/lightrigd.socket DESTINATION lib/systemd/system)
install(FILES systemd/lightrig.sysusers DESTINATION lib/sysusers.d RENAME lightrig.conf)
install(FILES systemd/lightrig.tmpfiles DESTINATION lib/tmpfiles.d RENAME lightrig.conf)
install(FILES systemd/70-lightrig.rules DESTINATION lib/udev/rules.d)

# Completion scripts are what the program itself prints.
foreach(shell IN ITEMS bash zsh fish)
  add_custom_command(OUTPUT completion.${shell} COMMAND lightrig completion ${shell} > completion.${shell}
                     DEPENDS lightrig WORKING_DIRECTORY ${CMAKE_BINARY_DIR} VERBATIM)
endforeach()
add_custom_target(completions ALL DEPENDS completion.bash completion.zsh completion.fish)
install(FILES ${CMAKE_BINARY_DIR}/completion.bash DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions
        RENAME lightrig)
install(FILES ${CMAKE_BINARY_DIR}/completion.zsh DESTINATION ${CMAKE_INSTALL_DATADIR}/zsh/vendor-completions
        RENAME _lightrig)
install(FILES ${CMAKE_BINARY_DIR}/completion.fish DESTINATION ${CMAKE_INSTALL_DATADIR}/fish/vendor_completions.d
        RENAME lightrig.fish)

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME lightrig)
set(CPACK_PACKAGE_CONTACT "The lightrig maintainers <lightrig@localhost>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "${PROJECT_DESCRIPTION}")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_DEPENDS "systemd")
set(CPACK_DEBIAN_PACKAGE_CONTROL_EXTRA 
    "${PROJECT_SOURCE_DIR}/systemd/postinst;${PROJECT_SOURCE_DIR}/systemd/prerm;${PROJECT_SOURCE_DIR}/systemd/postrm")
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(CPACK_STRIP_FILES ON)
include(CPack)
