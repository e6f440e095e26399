//! A store of its own for a test: over SQLite, or over PostgreSQL if `TEST_POSTGRES` names a server on which databases
//! may be made. So the same tests run over both; `tests/with-postgres` starts a server for it.

use std::path::Path;
use std::str::FromStr as _;

use sqlx::postgres::{PgConnectOptions, PgConnection};
use sqlx::{AssertSqlSafe, ConnectOptions as _, Connection as _};
use uuid::Uuid;

use super::{Database, Place, Store};

/// The URL of a fresh database on the server, if there is one. It ends with the server.
pub(crate) async fn database_url() -> Option<String> {
    let server = std::env::var("TEST_POSTGRES").ok()?;
    let name = format!("gable_{}", Uuid::now_v7().simple());
    let options = PgConnectOptions::from_str(&server).unwrap();
    let mut connection = PgConnection::connect_with(&options).await.unwrap();
    // the tables are made once, and copied for each test
    sqlx::query("SELECT pg_advisory_lock(1)").execute(&mut connection).await.unwrap();
    let template = template(&options, &mut connection).await;
    sqlx::query("SELECT pg_advisory_unlock(1)").execute(&mut connection).await.unwrap();
    let make = format!("CREATE DATABASE {name} TEMPLATE {template}");
    sqlx::query(AssertSqlSafe(make)).execute(&mut connection).await.unwrap();
    Some(options.database(&name).to_url_lossy().to_string())
}

async fn template(options: &PgConnectOptions, connection: &mut PgConnection) -> String {
    // of this program, whose migrations may be newer than those of the last one
    let program = std::env::current_exe().unwrap();
    let made = std::fs::metadata(program).unwrap().modified().unwrap();
    let age = made.duration_since(std::time::UNIX_EPOCH).unwrap().as_nanos();
    let name = format!("gable_template_{age}");
    let there: bool = sqlx::query_scalar("SELECT EXISTS (SELECT 1 FROM pg_database WHERE datname = $1)")
        .bind(&name)
        .fetch_one(&mut *connection)
        .await
        .unwrap();
    if !there {
        sqlx::query(AssertSqlSafe(format!("CREATE DATABASE {name}_made"))).execute(&mut *connection).await.unwrap();
        let made = options.clone().database(&format!("{name}_made"));
        let database = Database::postgres(made.to_url_lossy().as_str()).await.unwrap();
        database.migrate().await.unwrap();
        database.close().await;
        let rename = format!("ALTER DATABASE {name}_made RENAME TO {name}");
        sqlx::query(AssertSqlSafe(rename)).execute(&mut *connection).await.unwrap();
    }
    name
}

/// A store in a data folder, over the database of this run.
#[allow(dead_code, reason = "not every program of tests wants it")]
pub(crate) async fn store(folder: &Path) -> Store {
    let url = database_url().await;
    Store::connect(&Place { folder, database_url: url.as_deref(), objects_url: None }).await.unwrap()
}

#[allow(dead_code, reason = "not every program of tests wants it")]
/// Whether this run is over SQLite; says so if a test is left out because it is not.
pub(crate) fn over_sqlite() -> bool {
    let sqlite = std::env::var_os("TEST_POSTGRES").is_none();
    if !sqlite {
        eprintln!("skipped: it is about SQLite");
    }
    sqlite
}
