//! One pass over the file: every kinematic element is checked, remembered and written anew for urdf-rs.

use std::collections::{BTreeMap, HashMap};

use super::document::Document;
use super::elements::{self, Fault};
use super::error::UrdfError;
use super::parts::{OpenJoint, OpenLink, Taken};
use super::places::{Meaning, Place};
use super::source::{shorten, Notes, Source};
use super::tag::Tag;
use super::transmission::OpenTransmission;
use super::xml::{Node, Walker};

/// Most links and most joints of a file; keeps every later step short, urdf-rs above all.
const MAX_ELEMENTS: usize = 2_000;
/// Kinds of ignored elements that are listed.
const MAX_KINDS: usize = 24;
const XACRO: &str = "the file is a xacro source; expand it first: xacro in.xacro > out.urdf";

struct Guard<'s, 'a> {
    source: &'s Source<'a>,
    notes: &'s mut Notes,
    document: Document,
    places: Vec<Place>,
    link: Option<OpenLink>,
    joint: Option<OpenJoint>,
    transmission: Option<OpenTransmission>,
    /// Where each name was first met, by kind of element.
    taken: HashMap<(&'static str, String), usize>,
    ignored: BTreeMap<String, usize>,
}

/// Reads the whole file.
///
/// # Errors
/// [`UrdfError::Invalid`] for whatever a reader could misunderstand; see the module's documentation.
pub(super) fn read(source: &Source, notes: &mut Notes) -> Result<Document, UrdfError> {
    let mut guard = Guard {
        source,
        notes,
        document: Document {
            name: String::new(),
            root_at: 0,
            links: Vec::new(),
            joints: Vec::new(),
            rotors: Vec::new(),
            clean: "<robot name=\"robot\">\n".to_owned(),
        },
        places: Vec::new(),
        link: None,
        joint: None,
        transmission: None,
        taken: HashMap::new(),
        ignored: BTreeMap::new(),
    };
    let mut walker = Walker::new(source);
    loop {
        match walker.next()? {
            Node::Open(tag) => guard.open(&tag)?,
            Node::Close => guard.close()?,
            Node::Text(text, at) => guard.text(&text, at),
            Node::End => return Ok(guard.finish()),
        }
    }
}

impl Guard<'_, '_> {
    fn refuse(&self, element: &str, fault: Fault) -> UrdfError {
        self.source
            .refuse(fault.at, self.describe(element), fault.message)
    }

    fn refuse_tag(&self, tag: &Tag, message: impl Into<String>) -> UrdfError {
        let message = message.into();
        self.refuse(
            tag.name,
            Fault {
                at: tag.at,
                message,
            },
        )
    }

    /// `<origin> of joint "elbow"`.
    fn describe(&self, element: &str) -> String {
        match (&self.link, &self.joint) {
            (Some(link), _) => format!("<{element}> of link \"{}\"", link.name),
            (None, Some(joint)) => format!("<{element}> of joint \"{}\"", joint.name),
            (None, None) => format!("<{element}>"),
        }
    }

    fn open(&mut self, tag: &Tag) -> Result<(), UrdfError> {
        if tag.name.starts_with("xacro:") {
            return Err(self.refuse_tag(tag, XACRO));
        }
        let Some(&parent) = self.places.last() else {
            self.places.push(Place::Robot);
            return self.root(tag);
        };
        let place = match parent.meaning(tag.name) {
            Meaning::Read => self.read(parent, tag)?,
            Meaning::Ignore => {
                if parent.is_kinematic() {
                    self.count_ignored(tag.name);
                }
                Place::Skip
            }
            // Exporters write one where they mean nothing by it; what they may have meant is checked when the link ends.
            Meaning::Misplaced if parent == Place::Link && tag.name == "origin" => {
                if let Some(link) = &mut self.link {
                    link.stray_origin = Some(tag.at);
                }
                Place::Skip
            }
            Meaning::Misplaced => {
                let message =
                    "does not count at this place; move it, or close the element around it";
                return Err(self.refuse_tag(tag, message));
            }
            Meaning::Misspelt(known) => {
                return Err(self.refuse_tag(
                    tag,
                    format!("is no element of URDF here; is <{known}> meant?"),
                ));
            }
        };
        self.places.push(place);
        Ok(())
    }

    fn count_ignored(&mut self, name: &str) {
        if let Some(count) = self.ignored.get_mut(name) {
            *count += 1;
        } else if self.ignored.len() < MAX_KINDS {
            self.ignored.insert(name.to_owned(), 1);
        }
    }

    fn root(&mut self, tag: &Tag) -> Result<(), UrdfError> {
        let other = match tag.name {
            "robot" => {
                self.document.root_at = tag.at;
                match tag.get("name") {
                    Some(name) => self.document.name = name.value.clone().into_owned(),
                    None => self.notes.at(self.source, tag.at, "the robot has no name"),
                }
                return Ok(());
            }
            "sdf" | "world" => "this is SDF; convert it to URDF",
            "mujoco" => "this is a MuJoCo model; convert it to URDF",
            "html" => "this is a web page; download the raw file",
            _ => "this is no URDF",
        };
        Err(self.refuse_tag(
            tag,
            format!(
                "the root element is <{}>, expected <robot>; {other}",
                tag.name
            ),
        ))
    }

    fn read(&mut self, parent: Place, tag: &Tag) -> Result<Place, UrdfError> {
        let unexpanded = |value: &str| value.contains("${") || value.contains("$(");
        if let Some(attribute) = tag.attributes.iter().find(|a| unexpanded(&a.value)) {
            let message = format!(
                "{} is \"{}\"; {XACRO}",
                attribute.name,
                shorten(&attribute.value)
            );
            return Err(self.refuse(
                tag.name,
                Fault {
                    at: attribute.at,
                    message,
                },
            ));
        }
        let taken = self
            .element(parent, tag)
            .map_err(|fault| self.refuse(tag.name, fault))?;
        if let Some(remark) = taken.remark {
            let sentence = format!("{}: {remark}", self.describe(tag.name));
            self.notes.at(self.source, tag.at, sentence);
        }
        Ok(taken.place)
    }

    /// Takes in an element that is read where it stands.
    fn element(&mut self, parent: Place, tag: &Tag) -> Result<Taken, Fault> {
        let mut remark = None;
        let place = match (parent, tag.name) {
            (Place::Robot, "link") => {
                let name = elements::name(tag)?;
                self.claim("link", &name, tag, self.document.links.len())?;
                self.link = Some(OpenLink::new(name, tag));
                remark = elements::idle(tag, &["name", "type"]);
                Place::Link
            }
            (Place::Robot, "joint") => {
                let name = elements::name(tag)?;
                self.claim("joint", &name, tag, self.document.joints.len())?;
                self.joint = Some(OpenJoint::new(name, elements::motion(tag)?, tag));
                remark = elements::idle(tag, &["name", "type"]);
                Place::Joint
            }
            (Place::Robot, _) => {
                self.transmission = Some(OpenTransmission::new(tag.at));
                Place::Transmission
            }
            _ => match (&mut self.link, &mut self.joint, &mut self.transmission) {
                (Some(link), _, _) => return link.element(tag),
                (_, Some(joint), _) => return joint.element(tag),
                (_, _, Some(transmission)) => transmission.element(tag),
                _ => Place::Skip,
            },
        };
        Ok(Taken { place, remark })
    }

    /// Refuses a name that is taken, and a file with too many links or joints.
    fn claim(
        &mut self,
        kind: &'static str,
        name: &str,
        tag: &Tag,
        count: usize,
    ) -> Result<(), Fault> {
        let fault = |message| {
            Err(Fault {
                at: tag.at,
                message,
            })
        };
        if count >= MAX_ELEMENTS {
            return fault(format!(
                "more than {MAX_ELEMENTS} {kind}s; a robot has fewer"
            ));
        }
        if let Some(first) = self.taken.insert((kind, name.to_owned()), tag.at) {
            let (line, _) = self.source.position(first);
            return fault(format!(
                "the name \"{name}\" is taken by the {kind} on line {line}; rename or delete one"
            ));
        }
        Ok(())
    }

    fn text(&mut self, text: &str, at: usize) {
        match self.places.last() {
            Some(Place::Reduction) => {
                if let Some(transmission) = &mut self.transmission {
                    transmission.text(text);
                }
            }
            Some(place) if place.is_kinematic() => {
                let sentence = format!(
                    "text between elements does not count: \"{}\"",
                    shorten(text.trim())
                );
                self.notes.at(self.source, at, sentence);
            }
            _ => {}
        }
    }

    fn close(&mut self) -> Result<(), UrdfError> {
        match self.places.pop() {
            Some(Place::Link) => self.link.take().map_or(Ok(()), |link| {
                let name = format!("link \"{}\"", link.name);
                if let Some(at) = link.stray_origin {
                    let sentence = format!(
                        "<origin> of {name} does not count: a link has its frame from its joint"
                    );
                    self.notes.at(self.source, at, sentence);
                }
                let finished = link.finish(&mut self.document);
                finished.map_err(|fault| self.source.refuse(fault.at, name, fault.message))
            }),
            Some(Place::Joint) => self.joint.take().map_or(Ok(()), |joint| {
                let name = format!("joint \"{}\"", joint.name);
                let finished = joint.finish(&mut self.document);
                finished.map_err(|fault| self.source.refuse(fault.at, name, fault.message))
            }),
            Some(Place::Transmission) => {
                let rotor = self
                    .transmission
                    .take()
                    .map_or(Ok(None), OpenTransmission::finish);
                let rotor = rotor.map_err(|fault| self.refuse("transmission", fault))?;
                self.document.rotors.extend(rotor);
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn finish(mut self) -> Document {
        self.document.clean.push_str("</robot>\n");
        if !self.ignored.is_empty() {
            let kinds: Vec<String> = self
                .ignored
                .iter()
                .map(|(kind, n)| format!("<{kind}> ({n})"))
                .collect();
            let sentence = format!("elements that do not count here: {}", kinds.join(", "));
            self.notes.at(self.source, self.document.root_at, sentence);
        }
        self.document
    }
}
