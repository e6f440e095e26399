//! Gable finds the exterior orientation of a single aerial image from the roof lines of buildings, and says whether
//! its own answer may be used.
//!
//! The rooms, in reading order; each knows only those above it.

pub mod geometry;

pub mod estimation;

pub mod features;

pub mod scenes;

pub mod orientation;

pub mod learning;

pub mod diagnosis;

pub mod interior;

pub mod pipeline;

pub mod classifiers;

pub mod simulation;

pub mod study;

pub mod imagery;

pub mod buildings;

pub mod geoids;

pub mod cameras;

pub mod database;

pub mod control;

pub mod flight;

pub mod exports;

pub mod orthos;

pub mod store;

pub mod report;

pub mod jobs;

pub mod webhooks;

pub mod configuration;

pub mod web;

pub mod http;

pub mod service;

pub mod cli;
