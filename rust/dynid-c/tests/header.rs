//! `dynid.h` is what cbindgen makes of the sources today.

use std::fs;
use std::path::Path;

/// Set to write the header instead of comparing it.
const WRITE: &str = "DYNID_WRITE_HEADER";

#[test]
fn the_header_is_up_to_date() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let config = cbindgen::Config::from_file(root.join("cbindgen.toml")).expect("a configuration");
    let sources = ["failure.rs", "model.rs", "estimator.rs"];
    let mut builder = cbindgen::Builder::new().with_config(config);
    for source in sources {
        builder = builder.with_src(root.join("src").join(source));
    }
    let mut made = Vec::new();
    builder.generate().expect("a header").write(&mut made);
    let made = plain(&String::from_utf8(made).expect("text"));
    let path = root.join("dynid.h");
    if std::env::var_os(WRITE).is_some() {
        fs::write(&path, &made).expect("a folder that can be written");
    }
    let there = fs::read_to_string(&path).unwrap_or_default();
    assert!(
        there == made,
        "rust/dynid-c/dynid.h is not what the sources say; write it anew: {WRITE}=1 cargo test -p dynid-c --test header"
    );
}

/// The sources' comments are Markdown for rustdoc; C readers want neither its escapes nor the `# Safety` heading.
fn plain(header: &str) -> String {
    header
        .replace("\\[", "[")
        .replace("\\]", "]")
        .replace("\n # Safety\n", "\n")
        .replace('`', "")
}
