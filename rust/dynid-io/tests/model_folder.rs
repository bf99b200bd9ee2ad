//! A folder in the place of a model: the sentence names the model that a result's folder holds.

use std::io::ErrorKind;

use dynid_io::ModelFileError;

#[test]
fn the_model_in_the_folder_is_named() {
    let folder = std::env::temp_dir();
    let error = dynid_io::load(&folder).unwrap_err();
    let inside = folder.join("model.json");
    let said = format!(
        "this is a folder; name the model in it, {}",
        inside.display()
    );
    assert_eq!(error.to_string(), format!("{}: {said}", folder.display()));
    let ModelFileError::Io { source, .. } = error else {
        panic!("{error}")
    };
    assert_eq!(source.kind(), ErrorKind::IsADirectory);
}
