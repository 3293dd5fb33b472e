//! Finds MuJoCo, generates its bindings and says how to link it.
//!
//! Search order: `MUJOCO_DIR` (an upstream release, or an unpacked PyPI wheel's `mujoco` folder), then Debian's
//! `libmujoco-dev`. Everything that is missing ends in one error that names what to install.
//!
//! With `DOCS_RS` set, as docs.rs does, nothing is searched for: the bindings are those of `docs/mujoco-2.2.2.rs`, which
//! is what this file generates from Debian's package. That is enough for `cargo doc` and `cargo check`.

use std::collections::{BTreeSet, HashSet};
use std::env;
use std::fs;
use std::path::{Path, PathBuf};

/// Header versions (`mjVERSION_HEADER`) that are known to work; others are tried, with a warning.
const TESTED: &[u32] = &[222, 337, 3_017_000, 4_000_001];

/// A version whose results are wrong, and why.
const WRONG: (u32, &str) =
    (4_000_000, "its Newton solver has a wrong Hessian where the matrices are sparse; 4.0.1 is right");

/// The bindings of 2.2.2, for documentation where no MuJoCo is installed.
const DOCUMENTED: &str = "docs/mujoco-2.2.2.rs";

/// What a version of MuJoCo 3 or later may or may not have: the flag with which `src/mujoco/compat/v3` asks for it, the name in
/// the headers that tells, and other names without which the code does if need be.
const FEATURES: &[(&str, &str, &[&str])] = &[
    ("mj_adhesion", "geom_adhesion", &["pair_adhesion"]),
    ("mj_abstract_camera", "mjMOUSE_TURN_V", &[]),
    ("mj_actuator_outputs", "actuator_outadr", &["nactuator", "nout"]),
    ("mj_delays", "nhistory", &[]),
    ("mj_efc_diag_a", "efc_diagA", &["efc_diagApprox"]),
    ("mj_factored_rows", "efc_Y", &["nY"]),
    ("mj_lazy_flags", "flg_rnepost", &["flg_energypos"]),
    ("mj_log_handler", "mjLogMessage", &["mjLOG_ERROR", "mjLOG_WARNING"]),
    ("mj_narrow_phase", "mjPreContact", &[]),
    ("mj_sleep", "mjENBL_SLEEP", &[]),
    ("mj_sparse_tendons", "nJten", &[]),
    ("mj_warn_vgeomfull", "mjWARN_VGEOMFULL", &[]),
];

/// Where MuJoCo is: an include folder that holds `mujoco/mujoco.h`, and one library file.
struct Installation {
    include: PathBuf,
    library: PathBuf,
    /// Whether the dynamic loader looks there by itself.
    in_system_path: bool,
}

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=MUJOCO_DIR");
    println!("cargo::rerun-if-env-changed=LIBCLANG_PATH");
    println!("cargo::rerun-if-env-changed=BINDGEN_EXTRA_CLANG_ARGS");
    println!("cargo::rerun-if-env-changed=DOCS_RS");
    println!("cargo::rustc-check-cfg=cfg(mujoco3)");
    for (flag, ..) in FEATURES {
        println!("cargo::rustc-check-cfg=cfg({flag})");
    }
    if env::var_os("DOCS_RS").is_some() {
        println!("cargo::rerun-if-changed={DOCUMENTED}");
        let bindings = fs::read_to_string(DOCUMENTED);
        return write(&bindings.unwrap_or_else(|e| fail(&format!("cannot read {DOCUMENTED}: {e}"))));
    }

    let found = find().unwrap_or_else(|why| fail(&why));
    let headers = found.include.join("mujoco");
    println!("cargo::rerun-if-changed={}", headers.display());
    println!("cargo::rerun-if-changed={}", found.library.display());

    let version = header_version(&headers.join("mujoco.h")).unwrap_or_else(|why| fail(&why));
    let is_3 = version >= 300;
    if version == WRONG.0 {
        fail(&format!("the headers in {} are of MuJoCo {}: {}", headers.display(), readable(version), WRONG.1));
    }
    if !is_3 && version / 10 != 22 {
        fail(&format!(
            "the headers in {} are of MuJoCo {}, with which mujoco-grasp does not work; it is tested with {}. Point \
             MUJOCO_DIR to one of those, or unset it to use Debian's package",
            headers.display(),
            readable(version),
            tested()
        ));
    }
    let bindings = generate(&found.include);
    let names: HashSet<&str> = bindings.split(|c: char| !c.is_alphanumeric() && c != '_').collect();

    if is_3 {
        println!("cargo::rustc-cfg=mujoco3");
    }
    for (flag, name, _) in FEATURES {
        if is_3 && names.contains(name) {
            println!("cargo::rustc-cfg={flag}");
        }
    }
    if !TESTED.contains(&version) {
        let what = format!("MuJoCo {} ({})", readable(version), headers.display());
        let missing = missing(&names, &found.library, is_3);
        if !missing.is_empty() {
            fail(&format!(
                "{what} lacks what mujoco-grasp needs: {}. Tested versions: {}; point MUJOCO_DIR to one of those",
                missing.join(", "),
                tested()
            ));
        }
        println!(
            "cargo::warning={what} is not among the versions that mujoco-grasp is tested with ({}). It is tried; run \
             the tests before you trust it",
            tested()
        );
    }
    write(&bindings);
    link(&found);
}

/// Where `src/mujoco/ffi.rs` includes them from.
fn write(bindings: &str) {
    let out = PathBuf::from(env::var_os("OUT_DIR").unwrap_or_default()).join("bindings.rs");
    fs::write(&out, bindings).unwrap_or_else(|e| fail(&format!("cannot write {}: {e}", out.display())));
}

/// What the crate's code uses and this version does not have, by name.
fn missing(names: &HashSet<&str>, library: &Path, is_3: bool) -> Vec<String> {
    let other = if is_3 { "v2.rs" } else { "v3" };
    let mut missing = BTreeSet::new();
    let mut folders = vec![PathBuf::from("src/mujoco")];
    while let Some(folder) = folders.pop() {
        for path in fs::read_dir(&folder).into_iter().flatten().flatten().map(|entry| entry.path()) {
            if path.is_dir() {
                folders.push(path);
            } else if !path.iter().any(|part| part == other) {
                let code = fs::read_to_string(&path).unwrap_or_default();
                missing.extend(used(&code).filter(|name| !names.contains(name)).map(str::to_owned));
            }
        }
    }
    for (_, name, more) in FEATURES {
        missing.retain(|known| known != name && !more.contains(&known.as_str()));
    }
    // Not in any header; a name of it would be an error of the linker.
    let handler = match names.contains("mjLogMessage") {
        true => "_mjPRIVATE_setTlsLogHandler",
        false => "_mjPRIVATE__set_tls_error_fn",
    };
    let exported = fs::read(library).unwrap_or_default();
    if !exported.windows(handler.len()).any(|bytes| bytes == handler.as_bytes()) {
        missing.insert(handler.to_owned());
    }
    missing.into_iter().collect()
}

/// Names of the engine in a source file: `ffi::mj...`, `(*d).name`, `(*m).name`, and what the macros for arrays and
/// stages list.
fn used(code: &str) -> impl Iterator<Item = &str> {
    fn leading(text: &str) -> &str {
        &text[..text.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(text.len())]
    }
    fn listed(line: &str) -> Option<&str> {
        let name = leading(line);
        match line[name.len()..].strip_prefix(": ") {
            Some(rest) => ["f64 [", "f32 [", "i32 [", "u8 ["].iter().any(|kind| rest.starts_with(kind)).then_some(name),
            None => line[name.len()..].strip_prefix(" = ").filter(|rest| rest.starts_with("mj_")).map(leading),
        }
    }
    let after = |start| code.split(start).skip(1).map(leading);
    let bindings = after("ffi::").filter(|name| name.starts_with("mj"));
    bindings.chain(after("(*d).")).chain(after("(*m).")).chain(code.lines().map(str::trim_start).filter_map(listed))
}

fn find() -> Result<Installation, String> {
    if let Some(dir) = env::var_os("MUJOCO_DIR").filter(|dir| !dir.is_empty()) {
        return find_in(Path::new(&dir));
    }
    let include = PathBuf::from("/usr/include");
    if !include.join("mujoco/mujoco.h").is_file() {
        return Err("MuJoCo's headers were not found in /usr/include/mujoco: install Debian's package libmujoco-dev \
             (apt install libmujoco-dev), or set MUJOCO_DIR to an unpacked MuJoCo release (for `cargo doc` alone, set \
             DOCS_RS=1)"
            .into());
    }
    let folders = [format!("/usr/lib/{}", multiarch()), "/usr/lib64".into(), "/usr/lib".into()];
    let library = folders.iter().find_map(|dir| library_in(Path::new(dir))).ok_or_else(|| {
        format!(
            "libmujoco.so was not found in {}: install Debian's package libmujoco-dev (apt install libmujoco-dev), \
             or set MUJOCO_DIR to an unpacked MuJoCo release",
            folders.join(", ")
        )
    })?;
    Ok(Installation { include, library, in_system_path: true })
}

/// An upstream release has `include/` and `lib/`; an unpacked wheel has `include/` and the library beside it.
fn find_in(dir: &Path) -> Result<Installation, String> {
    let dir = dir.canonicalize().map_err(|e| format!("MUJOCO_DIR={}: {e}", dir.display()))?;
    let include = [dir.join("include"), dir.join("mujoco/include")]
        .into_iter()
        .find(|include| include.join("mujoco/mujoco.h").is_file())
        .ok_or_else(|| {
            format!(
                "MUJOCO_DIR={}: there is no include/mujoco/mujoco.h below it (an unpacked MuJoCo release, or an \
                 unpacked PyPI wheel's mujoco folder, has one)",
                dir.display()
            )
        })?;
    let folders = ["lib", "lib64", ".", "mujoco"].map(|sub| dir.join(sub));
    let multiarch = dir.join("lib").join(multiarch());
    let library =
        folders.iter().chain([&multiarch]).find_map(|folder| library_in(folder)).ok_or_else(|| {
            format!("MUJOCO_DIR={}: there is no libmujoco.so in it or in its lib folder", dir.display())
        })?;
    Ok(Installation { include, library, in_system_path: false })
}

/// `libmujoco.so` if there is one, else the versioned file of a wheel (`libmujoco.so.2.2.2`).
fn library_in(dir: &Path) -> Option<PathBuf> {
    let plain = dir.join("libmujoco.so");
    if plain.is_file() {
        return Some(plain);
    }
    let mut versioned: Vec<PathBuf> = fs::read_dir(dir)
        .ok()?
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.file_name().and_then(|name| name.to_str()).is_some_and(|n| n.starts_with("libmujoco.so.")))
        .collect();
    versioned.sort();
    versioned.pop()
}

fn multiarch() -> String {
    let arch = env::var("CARGO_CFG_TARGET_ARCH").unwrap_or_else(|_| "x86_64".into());
    format!("{arch}-linux-gnu")
}

fn header_version(header: &Path) -> Result<u32, String> {
    let text = fs::read_to_string(header).map_err(|e| format!("cannot read {}: {e}", header.display()))?;
    text.lines()
        .find_map(|line| line.strip_prefix("#define mjVERSION_HEADER")?.split_whitespace().next()?.parse().ok())
        .ok_or_else(|| format!("{} does not define mjVERSION_HEADER", header.display()))
}

fn tested() -> String {
    TESTED.iter().map(|version| readable(*version)).collect::<Vec<_>>().join(", ")
}

/// 222 is 2.2.2; from 3.5 on the number is written 3005000.
fn readable(version: u32) -> String {
    match version {
        0..1000 => format!("{}.{}.{}", version / 100, version / 10 % 10, version % 10),
        _ => format!("{}.{}.{}", version / 1_000_000, version / 1000 % 1000, version % 1000),
    }
}

/// The bindings as Rust source.
fn generate(include: &Path) -> String {
    let builder = bindgen::Builder::default()
        .header_contents("mujoco_grasp_wrapper.h", "#include <mujoco/mujoco.h>\n")
        .clang_arg(format!("-I{}", include.display()))
        .allowlist_function("mj_.*|mju_.*|mjv_.*|mjr_.*")
        .allowlist_type("mj.*|_mj.*")
        .allowlist_var("mj.*")
        // The callbacks are process-global and the handlers would be, too: the guard uses the thread's own.
        .blocklist_item("mjcb_.*|mju_user_.*|mjCOLLISIONFUNC")
        // C may hand us any number: an unknown value of a Rust enum would be undefined behaviour.
        .default_enum_style(bindgen::EnumVariation::Consts)
        .prepend_enum_name(false)
        // The error handler unwinds through the engine, so every import must let it.
        .override_abi(bindgen::Abi::CUnwind, ".*")
        .derive_debug(false)
        .generate_comments(false)
        .layout_tests(false);

    // Without libclang bindgen panics; its report is replaced by one that says what to install.
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| {}));
    let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| builder.generate()));
    std::panic::set_hook(hook);
    match result {
        Ok(Ok(bindings)) => bindings.to_string(),
        Ok(Err(why)) => fail(&format!(
            "bindgen could not read MuJoCo's headers ({why}): it needs libclang with its own headers and the C \
             library's (apt install libclang-dev libc6-dev)"
        )),
        Err(_) => fail(
            "libclang was not found; bindgen needs it to read MuJoCo's headers: install Debian's package \
             libclang-dev (apt install libclang-dev), or set LIBCLANG_PATH to the folder of libclang.so",
        ),
    }
}

fn link(found: &Installation) {
    let folder = found.library.parent().unwrap_or(Path::new("/usr/lib"));
    let name = found.library.file_name().and_then(|name| name.to_str()).unwrap_or("libmujoco.so");
    println!("cargo::rustc-link-search=native={}", folder.display());
    if name == "libmujoco.so" {
        println!("cargo::rustc-link-lib=dylib=mujoco");
    } else {
        println!("cargo::rustc-link-lib=dylib:+verbatim={name}");
    }
    if !found.in_system_path {
        println!("cargo::rustc-link-arg=-Wl,-rpath,{}", folder.display());
    }
}

fn fail(message: &str) -> ! {
    println!("cargo::error={message}");
    std::process::exit(1);
}
